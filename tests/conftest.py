"""What tests share: where real data lies, and one thread a process.

Several tests run at once, and threads of BLAS that wait for work take it from the others. The libraries read these
variables when they are loaded, which is after this file.
"""

import os
from pathlib import Path

import pytest

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(_name, "1")

SHARED_DATA = Path(__file__).resolve().parents[1] / "../shared/data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with real input; tests that need it skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data is not here: no folder {SHARED_DATA.name} in shared/ beside the project")
    return SHARED_DATA.resolve()
