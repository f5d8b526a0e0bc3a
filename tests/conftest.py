"""What tests share: where real data lies, and small exact drives."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[1] / "../shared/data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with real input; tests that need it skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data is not here: no folder {SHARED_DATA.name} in shared/ beside the project")
    return SHARED_DATA.resolve()
