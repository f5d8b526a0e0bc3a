"""Versions of what results depend on, here and where the work is done."""

import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version

from boxcal.version import code_sha256, installed_version

_PACKAGES = {"numpy": "numpy", "scipy": "scipy", "numba": "numba", "opencv": "opencv-contrib-python-headless"}
OURS = ("boxcal", "boxcal's code")
"""What must be the same everywhere: version, and the sources themselves (their hash), which tell builds apart."""


def versions() -> dict[str, str]:
    """Return the versions of boxcal, Python and the packages that results depend on, by name."""
    ours = dict(zip(OURS, (installed_version(), code_sha256()[:12]), strict=True))
    return {**ours, "python": platform.python_version(), **{n: _of(p) for n, p in _PACKAGES.items()}}


def _of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "another build"


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> Iterator[str]:
    """Yield what differs, in words: numpy 2.4.6 there, 2.3.1 here."""
    for name, mine in here.items():
        other = there.get(name, "none")
        if other != mine:
            yield f"{name} {other} there, {mine} here"
