"""The cache of a function's compiled code: one folder, wherever its source lies and whenever it was written.

numba by itself names its folders by the place of the source and takes code for stale whose source was written anew, as
an installer does. Here the folder's own name says what the code was made of (:mod:`.kernel`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

_CACHING: Any = import_module("numba.core.caching")


def keep_in(folder: Path, function: Callable[..., Any], *, written: bool) -> None:
    """Have the code of a compiled function read from a folder and, unless that is only read, written there."""
    inside: Any = function
    source: Any = inside.py_func
    place = _Place(folder, str(source.__code__.co_firstlineno))
    implementation = type("_Implementation", (_CACHING.CompileResultCacheImpl,), {"_locator_classes": [place]})
    left_alone = {} if written else {"save_overload": _nothing_saved}
    kind = type("_Cache", (_CACHING.FunctionCache,), {"_impl_class": implementation, **left_alone})
    inside._cache = kind(source)  # noqa: SLF001 - what numba's enable_caching() does, with a cache of its own choice


@dataclass(frozen=True, slots=True)
class _Place:
    """A locator, as numba calls what says in which folder a function's code is kept, and what makes it stale."""

    folder: Path
    line: str

    def from_function(self, function: Any, file: str) -> "_Place":
        del function, file
        return self

    def get_cache_path(self) -> str:
        return str(self.folder)

    def ensure_cache_path(self) -> None:
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return self.line


def _nothing_saved(cache: Any, signature: Any, data: Any) -> None:
    """Leave an installed package as it is: what it lacks is compiled in memory."""
    del cache, signature, data
