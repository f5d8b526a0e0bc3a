"""What tests share: where real data lies, and small exact drives."""

from pathlib import Path

import pytest

COMPILED = Path(__file__).resolve().parents[1] / "detect" / "alignment" / "numba"
SHARED_DATA = Path(__file__).resolve().parents[1] / "../shared/data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with real input; tests that need it skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data is not here: no folder {SHARED_DATA.name} in shared/ beside the project")
    return SHARED_DATA.resolve()


def pytest_configure(config: pytest.Config) -> None:
    """Drop compiled code older than what it is made of: of a function numba looks only at its own file."""
    if hasattr(config, "workerinput"):
        return
    align = COMPILED.parent
    sources = [*COMPILED.glob("*.py"), *(align / "registration").glob("*.py"), align / "radial_camera.py"]
    newest = max(source.stat().st_mtime for source in sources)
    for kept in (COMPILED / "__pycache__").glob("*.nb[ic]"):
        if kept.stat().st_mtime < newest:
            kept.unlink()
