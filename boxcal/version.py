"""The version that is installed."""

import hashlib
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


@cache
def installed_version() -> str:
    """Return the version of the installed boxcal, or ``not installed`` where it runs from its sources alone."""
    try:
        return version("boxcal")
    except PackageNotFoundError:
        return "not installed"


@cache
def code_sha256() -> str:
    """Return the SHA-256 of the program's own sources, hexadecimal: it distinguishes builds of one version."""
    digest = hashlib.sha256()
    for package, pattern in (("", "*.py"), (".target", "**/*.py"), (".detect", "**/*.py"), (".calib", "**/*.py")):
        for root in import_module(f"boxcal{package}").__path__:
            for path in sorted(Path(root).glob(pattern)):
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
