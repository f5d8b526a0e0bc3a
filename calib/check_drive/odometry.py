"""Odometry of a calibrated robot between stops, with the covariance that its calibration predicts."""

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.diff_drive import legs_between
from boxcal.calib.likelihood.leg_model import LegModel, leg_model
from boxcal.calib.likelihood.wheel_path import wheel_path
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Detail
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


def odometry(calibration: Calibration, drive: Correspondences) -> LegModel:
    """Return the displacement of every leg of a drive by the calibrated wheels, with its derivatives."""
    path = wheel_path([legs_between(drive)])
    w, exact = calibration.wheels, np.zeros((path.legs, 2))
    return leg_model(path, np.array([w.rR, w.rL, w.b]), exact, exact)


def wheel_noise(detail: Detail, model: LegModel, i: int) -> Array:
    """Return the covariance of leg i by slip and by the encoders' rounding at its ends, (3, 3), m and rad."""
    ends = model.d_start[i] @ model.d_start[i].T + model.d_end[i] @ model.d_end[i].T
    return np.asarray(detail.noise.slip**2 * model.slip[i] + detail.noise.encoder_step**2 / 12 * ends)


def detail_of(calibration: Calibration) -> Detail:
    """Return what a calibration says about its uncertainty.

    Raises
    ------
    CalibError
        If it is of the closed form, which predicts no errors.
    """
    if calibration.detail is None:
        raise CalibError(
            "a calibration by the closed form predicts no errors",
            source=calibration.robot,
            remedy="calibrate without --closed-form",
        )
    return calibration.detail
