"""Build of the distribution: setuptools', and a wheel takes compiled code for this computer along.

Without that the first command compiles what it needs, half a minute of work. A wheel that is built to be installed
here, as by ``pip install .``, has it inside, for this processor and the versions of Python and numba that it was built
with; elsewhere it is passed over, and the first command compiles. Wheels to be published go without:
``python -m build --config-setting compile=no``. An editable installation never has it.
"""

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)
from setuptools.command.build_py import build_py

__all__ = [
    "BuildWithCompiledCode",
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

Settings = Mapping[str, Any] | None
_SWITCH = "BOXCAL_BUILD_COMPILES"
_COMPILER = "boxcal.calib.likelihood.compiled.compilation"


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return what compiling needs: what the package itself needs."""
    if not _compiles(config_settings):
        return []
    here = Path(__file__).resolve().parent / "pyproject.toml"
    needed: list[str] = tomllib.loads(here.read_text(encoding="utf-8"))["project"]["dependencies"]
    return needed


def build_wheel(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """Build a wheel, with compiled code unless the setting ``compile`` is ``no``; return its name."""
    os.environ[_SWITCH] = "yes" if _compiles(config_settings) else "no"
    rest = {name: value for name, value in (config_settings or {}).items() if name != "compile"}
    return build_meta.build_wheel(wheel_directory, rest, metadata_directory)


def _compiles(config_settings: Settings) -> bool:
    said = (config_settings or {}).get("compile", "yes")
    if said not in ("yes", "no"):
        raise SystemExit(f"config setting compile={said}: it is yes or no")
    return bool(said == "yes")


class BuildWithCompiledCode(build_py):
    """Copy the modules, then compile what numba compiles into the copy."""

    def run(self) -> None:
        """Copy and compile; where compiling fails, say so: the package works without."""
        super().run()
        if self.editable_mode:
            return
        library = Path(self.build_lib).resolve()
        folder = library / "boxcal" / "detect" / "alignment" / "numba" / "compiled"
        shutil.rmtree(folder, ignore_errors=True)  # an earlier build of the same tree left its own
        if os.environ.get(_SWITCH) != "yes":
            return
        found = os.pathsep.join([str(library), *filter(None, [os.environ.get("PYTHONPATH")])])
        done = subprocess.run(  # noqa: S603 - this package's own module
            [sys.executable, "-P", "-m", _COMPILER, str(folder)],
            env={**os.environ, "PYTHONPATH": found, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            self.warn(f"nothing is compiled ahead, the first command will do so:\n{done.stderr[-2000:]}")
