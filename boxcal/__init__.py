"""Calibrate every robot's camera, wheels and camera extrinsics from one AprilTag box and the robot's log.

The names of ``__all__`` are the public interface; they are loaded when they are first used, so that ``import boxcal``
is instant. Lengths are in m, angles in rad, pixels from the centre of the top-left pixel; docs/conventions.md has the
frames.

Examples
--------
>>> import boxcal
>>> simulated = boxcal.simulate(stops=10, seed=1)
>>> found = boxcal.calibrate(simulated.correspondences, simulated.target)
>>> str(found.verdict.level)
'good'
>>> bool(abs(found.wheels.b / simulated.robot.b - 1) < 0.003)
True
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from boxcal.calib.calibrate import calibrate as calibrate
    from boxcal.calib.calibrate import calibrate_cameras as calibrate_cameras
    from boxcal.calib.joint_box.api import refine_box as refine_box
    from boxcal.calib.results.calibration import Calibration as Calibration
    from boxcal.calib.results.json_format import load_calibration as load_calibration
    from boxcal.calib.results.json_format import save_calibration as save_calibration
    from boxcal.calib.settings import Settings as Settings
    from boxcal.calib.simulate.simulated_drive import simulate as simulate
    from boxcal.detect.alignment.detector import detect_tags as detect_tags
    from boxcal.detect.correspondences import Correspondences as Correspondences
    from boxcal.detect.correspondences import load_correspondences as load_correspondences
    from boxcal.detect.extract import ExtractSettings as ExtractSettings
    from boxcal.detect.extract import extract as extract
    from boxcal.detect.log.topics import Topics as Topics
    from boxcal.detect.log.wheel_samples import JointUnit as JointUnit
    from boxcal.detect.log.wheel_samples import WheelUnits as WheelUnits
    from boxcal.target.box import Box as Box
    from boxcal.target.box import Target as Target
    from boxcal.target.box import make_target as make_target
    from boxcal.target.camera.distortion import CameraKind as CameraKind
    from boxcal.target.errors import BoxcalError as BoxcalError
    from boxcal.target.files.target_json import load_target as load_target
    from boxcal.target.files.target_json import save_target as save_target

    __version__: str

__all__ = [
    "Box",
    "BoxcalError",
    "Calibration",
    "CameraKind",
    "Correspondences",
    "ExtractSettings",
    "JointUnit",
    "Settings",
    "Target",
    "Topics",
    "WheelUnits",
    "__version__",
    "calibrate",
    "calibrate_cameras",
    "detect_tags",
    "extract",
    "load_calibration",
    "load_correspondences",
    "load_target",
    "make_target",
    "refine_box",
    "save_calibration",
    "save_target",
    "simulate",
]

_HOME = {
    "Box": "boxcal.target.box",
    "BoxcalError": "boxcal.target.errors",
    "Calibration": "boxcal.calib.results.calibration",
    "CameraKind": "boxcal.target.camera.distortion",
    "Correspondences": "boxcal.detect.correspondences",
    "ExtractSettings": "boxcal.detect.extract",
    "JointUnit": "boxcal.detect.log.wheel_samples",
    "Settings": "boxcal.calib.settings",
    "Target": "boxcal.target.box",
    "Topics": "boxcal.detect.log.topics",
    "WheelUnits": "boxcal.detect.log.wheel_samples",
    "calibrate": "boxcal.calib.calibrate",
    "calibrate_cameras": "boxcal.calib.calibrate",
    "detect_tags": "boxcal.detect.alignment.detector",
    "extract": "boxcal.detect.extract",
    "load_calibration": "boxcal.calib.results.json_format",
    "load_correspondences": "boxcal.detect.correspondences",
    "load_target": "boxcal.target.files.target_json",
    "make_target": "boxcal.target.box",
    "refine_box": "boxcal.calib.joint_box.api",
    "save_calibration": "boxcal.calib.results.json_format",
    "save_target": "boxcal.target.files.target_json",
    "simulate": "boxcal.calib.simulate.simulated_drive",
}
"""Module that each public name is loaded from; tests/test_api.py holds it to the imports above and to ``__all__``."""


if not TYPE_CHECKING:  # or else any misspelt name would have a type

    def __getattr__(name: str) -> object:
        """Return a public name on its first use (PEP 562)."""
        if name == "__version__":
            value: object = import_module("boxcal.version").installed_version()
        elif name in _HOME:
            value = getattr(import_module(_HOME[name]), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Return the public names, loaded or not."""
    return sorted({*globals(), *__all__})
