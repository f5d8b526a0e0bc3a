"""What tests share: where real data lies, one thread a process, and no work that every process would do again.

Several tests run at once, and threads of BLAS that wait for work take it from the others. The libraries read these
variables when they are loaded, which is after this file. Tests start some two hundred processes, each of which would
compile all sources that it imports where Python is told to keep none of its bytecode. While tests are collected nothing
becomes garbage, and looking for it took a third of the time.
"""

import gc
import os
import sys
from pathlib import Path

import pytest

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(_name, "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
gc.disable()

SHARED_DATA = Path(__file__).resolve().parents[1] / "../shared/data"


def pytest_collection_finish() -> None:
    """Look for garbage again, but not in what was imported."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with real input; tests that need it skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data is not here: no folder {SHARED_DATA.name} in shared/ beside the project")
    return SHARED_DATA.resolve()
