"""The lens of a calibration, under the names that others give it."""

from dataclasses import dataclass

from boxcal.calib.results.calibration import Calibration
from boxcal.target.camera.camera_model import CameraKind


@dataclass(frozen=True, slots=True, kw_only=True)
class Distortion:
    """A distortion model by its name and coefficients.

    Attributes
    ----------
    model
        As the other format calls it.
    coefficients
        In that format's order.
    """

    model: str
    coefficients: tuple[float, ...]


def ros_distortion(calibration: Calibration) -> Distortion:
    """Return the distortion as ``sensor_msgs/CameraInfo`` has it (``plumb_bob``: k1, k2, p1, p2, k3)."""
    kind, k = calibration.camera.kind, calibration.camera.distortion
    if kind is CameraKind.RADIAL:
        return Distortion(model="plumb_bob", coefficients=(*k, 0.0, 0.0, 0.0, 0.0))
    models = {
        CameraKind.BROWN: "plumb_bob",
        CameraKind.RATIONAL: "rational_polynomial",
        CameraKind.FISHEYE: "equidistant",
    }
    return Distortion(model=models[kind], coefficients=k)


def kalibr_distortion(calibration: Calibration) -> Distortion | None:
    """Return the distortion as Kalibr has it (``radtan``: k1, k2, p1, p2), None where it has no such model."""
    kind, k = calibration.camera.kind, calibration.camera.distortion
    if kind is CameraKind.RADIAL:
        return Distortion(model="radtan", coefficients=(*k, 0.0, 0.0, 0.0))
    if kind is CameraKind.FISHEYE:
        return Distortion(model="equidistant", coefficients=k)
    if kind is CameraKind.BROWN and k[4] == 0:
        return Distortion(model="radtan", coefficients=k[:4])
    return None
