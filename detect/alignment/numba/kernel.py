"""Compilation of functions by numba, and where compiled code is kept.

It lies in the installed package, if that was built on a computer like this one, else in the user's cache
(``~/.cache/boxcal``, or where ``NUMBA_CACHE_DIR``, ``XDG_CACHE_HOME`` or the system says): in a folder named by the
hash of its sources, of numba's and Python's version, of numba's settings and of the processor, so that an update never
meets old code and any copy of the same sources finds it. Without a place that can be written it is compiled in memory,
in each process; with ``NUMBA_DISABLE_JIT`` set it is not compiled, and nothing is kept.
"""

import hashlib
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from numba import __version__, njit

from boxcal.detect.alignment.numba.kept_code import keep_in

COMPLETE = "complete"
"""Name of the empty file that says of a folder that all code is there."""
_CONFIG: Any = import_module("numba.core.config")
_APPDIRS: Any = import_module("numba.misc.appdirs")
_HERE = Path(__file__).resolve().parent
_INSTALLED = _HERE / "compiled"
_SOURCES = (
    *sorted(_HERE.glob("*.py")),
    *sorted((_HERE.parent / "registration").glob("*.py")),
    *(_HERE.parent / name for name in ("box_refinement.py", "outlines.py", "radial_camera.py")),
)
"""Of the compiled code and of the constants in it."""
_SETTINGS = ("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")
"""Of numba, by its environment variables: other code is compiled under others."""


@cache
def cache_folder() -> Path | None:
    """Return the folder for the detector's compiled code, made if need be; None if no place can be written."""
    return folder_for(_SOURCES)


def folder_for(sources: Iterable[Path]) -> Path | None:
    """Return the folder for code compiled from some sources, made if need be; None if none is to be kept or can be."""
    if _CONFIG.DISABLE_JIT:
        return None
    name = _name(sources)
    if (_INSTALLED / name / COMPLETE).exists():
        return _INSTALLED / name
    places = [Path(_CONFIG.CACHE_DIR)] if _CONFIG.CACHE_DIR else []
    places += [Path(_APPDIRS.user_cache_dir("boxcal"))]
    for place in places:
        folder = place / name
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    return None


def _name(sources: Iterable[Path]) -> str:
    """Return the name of a folder: it differs where code compiled elsewhere could not be used."""
    asked = tuple(repr(getattr(_CONFIG, name)) for name in _SETTINGS)
    digest = hashlib.sha256(repr((__version__, sys.implementation.cache_tag, _processor(), asked)).encode())
    for source in sources:  # names of functions' files have the module's name and the line in them
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    return f"compiled-{digest.hexdigest()[:16]}"


def _processor() -> tuple[str, ...]:
    """Return what numba tells processors apart by: system, name and instruction sets."""
    registry: Any = import_module("numba.core.registry")
    told: tuple[str, ...] = registry.cpu_target.target_context.codegen().magic_tuple()
    return told


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def kernel(*, inner: bool = False, **options: Any) -> Decorator:
    """Compile a function of arrays and numbers at its first call.

    Parameters
    ----------
    inner
        Only compiled code calls it: it needs no entry point from Python, and is kept within what calls it. Both take
        time.
    options
        numba's beyond the usual ones.
    """
    return compiled_in(cache_folder(), inner=inner, **options)


def loops(**options: Any) -> Decorator:
    """Compile what only compiled code calls and what makes no arrays, only views: references are not counted.

    numba counts references by calls into its runtime, for each array that is handed over and for each part of one.
    Where a function nevertheless makes an array, numba refuses to compile it. What is called for each block of pixels
    is written into its caller (``forceinline``): to hand over its arrays takes as long as ten pixels. For the options
    see :func:`kernel`.
    """
    return kernel(inner=True, _nrt=False, **options)


def compiled_in(folder: Path | None, *, inner: bool = False, **options: Any) -> Decorator:
    """Return a decorator as :func:`kernel` does, of code that is kept in a folder, if there is one."""
    wrappers: dict[str, Any] = {"no_cpython_wrapper": inner, "no_cfunc_wrapper": True}

    def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
        made: Callable[..., Any] = njit(nogil=True, error_model="numpy", **wrappers, **options)(function)
        if folder is not None and not inner:
            keep_in(folder, made, written=folder.parent != _INSTALLED)
        return made

    return compiled
