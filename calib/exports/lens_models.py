"""The lens of a calibration, under the names that others give it."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.geometry.so3_se3 import Array
from boxcal.calib.results.calibration import Calibration
from boxcal.target.camera.camera_model import Lens, extra_names


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


def lens_of(calibration: Calibration) -> tuple[Lens, Array]:
    """Return the lens model and its values (fu, fv, cu, cv, kr and the model's further coefficients)."""
    c = calibration.camera
    lens = Lens.RADIAL if calibration.detail is None else Lens(calibration.detail.lens)
    extra = {} if calibration.detail is None else calibration.detail.lens_extra
    return lens, np.array([c.fu, c.fv, c.cu, c.cv, c.kr, *(extra[name] for name in extra_names(lens))])


def ros_distortion(calibration: Calibration) -> Distortion:
    """Return the distortion as ``sensor_msgs/CameraInfo`` has it (``plumb_bob``: k1, k2, p1, p2, k3)."""
    lens, values = lens_of(calibration)
    k = tuple(values[4:].tolist())
    if lens is Lens.RADIAL:
        return Distortion(model="plumb_bob", coefficients=(*k, 0.0, 0.0, 0.0, 0.0))
    models = {Lens.BROWN: "plumb_bob", Lens.RATIONAL: "rational_polynomial", Lens.FISHEYE: "equidistant"}
    return Distortion(model=models[lens], coefficients=k)


def kalibr_distortion(calibration: Calibration) -> Distortion | None:
    """Return the distortion as Kalibr has it (``radtan``: k1, k2, p1, p2), None where it has no such model."""
    lens, values = lens_of(calibration)
    k = tuple(values[4:].tolist())
    if lens is Lens.RADIAL:
        return Distortion(model="radtan", coefficients=(*k, 0.0, 0.0, 0.0))
    if lens is Lens.FISHEYE:
        return Distortion(model="equidistant", coefficients=k)
    if lens is Lens.BROWN and k[4] == 0:
        return Distortion(model="radtan", coefficients=k[:4])
    return None
