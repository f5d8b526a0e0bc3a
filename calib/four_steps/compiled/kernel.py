"""Compilation of step 1's loops, kept like the detector's compiled code."""

from functools import cache
from pathlib import Path
from typing import Any

from boxcal.detect.alignment.numba.kernel import Decorator, compiled_in, folder_for

_SOURCES = tuple(sorted(Path(__file__).resolve().parent.glob("*.py")))


@cache
def cache_folder() -> Path | None:
    """Return the folder for step 1's compiled code, made if need be; None if no place can be written."""
    return folder_for(_SOURCES)


def kernel(**options: Any) -> Decorator:
    """Compile a function of arrays and numbers at its first call; see :func:`boxcal.detect.alignment.numba.kernel`."""
    return compiled_in(cache_folder(), **options)
