"""Maximum likelihood: the answer, its uncertainty, and what the drive does not determine.

Its names are loaded when they are first used: who reads a saved result needs a part of it only.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from boxcal.calib.likelihood.estimate import Estimate as Estimate
    from boxcal.calib.likelihood.options import EstimateOptions as EstimateOptions
    from boxcal.target.camera.camera_model import CameraKind as CameraKind

_HOME = {
    "CameraKind": "boxcal.target.camera.camera_model",
    "Estimate": "boxcal.calib.likelihood.estimate",
    "EstimateOptions": "boxcal.calib.likelihood.options",
}

if not TYPE_CHECKING:  # or else any misspelt name would have a type

    def __getattr__(name: str) -> object:
        """Return a name on its first use (PEP 562)."""
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(_HOME[name]), name)
