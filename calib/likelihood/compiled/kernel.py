"""Compilation of the likelihood's loops, kept like the detector's compiled code."""

from functools import cache
from pathlib import Path
from typing import Any

from boxcal.detect.alignment.numba.kernel import Decorator, compiled_in, folder_for

_HERE = Path(__file__).resolve().parent
_SOURCES = (*sorted(_HERE.glob("*.py")), *(_HERE.parent / name for name in ("leg_propagation.py", "leg_sums.py")))
"""Of the compiled code and of the constants in it."""


@cache
def cache_folder() -> Path | None:
    """Return the folder for the likelihood's compiled code, made if need be; None if no place can be written."""
    return folder_for(_SOURCES)


def kernel(*, inner: bool = False, **options: Any) -> Decorator:
    """Compile a function of arrays and numbers at its first call; see :func:`boxcal.detect.alignment.numba.kernel`."""
    return compiled_in(cache_folder(), inner=inner, **options)
