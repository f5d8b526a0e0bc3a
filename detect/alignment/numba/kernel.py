"""Compilation of functions by numba, and the cache of compiled code.

Compiled code lies in the user's cache (``~/.cache/boxcal``, or where ``NUMBA_CACHE_DIR``, ``XDG_CACHE_HOME`` or the
system says), in a folder named by the hash of its sources and numba's version, so that an update never meets old code;
numba tells processors apart. Without a place that can be written it is compiled in memory, in each process.
"""

import hashlib
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from numba import __version__, njit

_CONFIG: Any = import_module("numba.core.config")
_APPDIRS: Any = import_module("numba.misc.appdirs")
_HERE = Path(__file__).resolve().parent
_SOURCES = (
    *sorted(_HERE.glob("*.py")),
    *sorted((_HERE.parent / "registration").glob("*.py")),
    _HERE.parent / "radial_camera.py",
)


@cache
def cache_folder() -> Path | None:
    """Return the folder for the detector's compiled code, made if need be; None if no place can be written."""
    return folder_for(_SOURCES)


def folder_for(sources: Iterable[Path]) -> Path | None:
    """Return the folder for code compiled from some sources, made if need be; None if no place can be written."""
    digest = hashlib.sha256(__version__.encode())
    for source in sources:  # with their place, by which the compiler names its files: another copy finds none of them
        digest.update(str(source).encode())
        digest.update(source.read_bytes())
    places = [Path(_CONFIG.CACHE_DIR)] if _CONFIG.CACHE_DIR else []
    places += [Path(_APPDIRS.user_cache_dir("boxcal"))]
    for place in places:
        folder = place / f"compiled-{digest.hexdigest()[:16]}"
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    return None


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def kernel(*, inner: bool = False, **options: Any) -> Decorator:
    """Compile a function of arrays and numbers at its first call.

    Parameters
    ----------
    inner
        Only compiled code calls it: it needs no way in from Python, and is kept within what calls it. Both take time.
    options
        numba's beyond the usual ones.
    """
    return compiled_in(cache_folder(), inner=inner, **options)


def compiled_in(folder: Path | None, *, inner: bool = False, **options: Any) -> Decorator:
    """Return a decorator as :func:`kernel` does, of code that is kept in a folder, if there is one."""
    kept = folder is not None and not inner
    wrappers: dict[str, Any] = {"no_cpython_wrapper": inner, "no_cfunc_wrapper": True}

    def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
        before = _CONFIG.CACHE_DIR
        _CONFIG.CACHE_DIR = str(folder or before)
        try:
            made: Callable[..., Any] = njit(cache=kept, nogil=True, error_model="numpy", **wrappers, **options)(
                function
            )
        finally:
            _CONFIG.CACHE_DIR = before
        return made

    return compiled
