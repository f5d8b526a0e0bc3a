"""One thread a process for BLAS, OpenCV and compiled code.

The matrices here are small: threads of BLAS spin more than they compute (a fleet takes twice the processor time), and a
fleet is calibrated in as many processes as there are cores anyway.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


def hold_process_to_one_thread() -> None:
    """Hold this process and those that it starts to one thread each; what the user has set already stays.

    Libraries read these variables when they are loaded, so commands call this before they import anything heavy.
    """
    for name in _VARIABLES:
        os.environ.setdefault(name, "1")


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold the libraries that are loaded to one thread for a while, as a call from a user's own program needs it."""
    if all(name in os.environ for name in _VARIABLES):
        yield
        return
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        opencv = sys.modules.get("cv2")
        before = opencv.getNumThreads() if opencv else 0
        if opencv:
            opencv.setNumThreads(1)
        try:
            yield
        finally:
            if opencv:
                opencv.setNumThreads(before)
