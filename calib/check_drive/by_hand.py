"""A check drive by hand: distance and turn by the calibrated wheels, against a tape and a mark on the floor."""

from dataclasses import asdict, dataclass
from math import erfc, sqrt

import numpy as np

from boxcal.calib.check_drive.odometry import detail_of, odometry, wheel_noise
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.leg_model import LegModel
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import WHEELS, Detail
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.stops import Stop, find_stops
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """One length or angle of a check drive by the calibrated wheels, against what was measured.

    Attributes
    ----------
    odometry, measured
        By the wheels, and by tape or mark; m or rad.
    sigma
        Predicted standard deviation of their difference, the measurement's included.
    """

    odometry: float
    measured: float
    sigma: float

    @property
    def sigmas(self) -> float:
        """The difference in predicted standard deviations."""
        return (self.odometry - self.measured) / self.sigma

    @property
    def p_value(self) -> float:
        """Probability of a difference at least as large where the prediction holds."""
        return erfc(abs(self.sigmas) / sqrt(2))


def check_distance(calibration: Calibration, wheels: WheelSamples, tape: float, tape_sigma: float) -> Measured:
    """Return the distance from the first standing to the last, by the wheels and by a tape.

    Parameters
    ----------
    calibration
        What the robot drives with.
    wheels
        Its wheel samples; no images are needed.
    tape, tape_sigma : m
        What the tape read between two marks below one point of the axle's middle, and its standard deviation.

    Raises
    ------
    CalibError
        If the calibration has no covariance, or the robot did not drive between two standings.
    """
    detail = detail_of(calibration)
    model = _between_standings(calibration, wheels)
    x, y = model.displacement[0, :2]
    distance = float(np.hypot(x, y))
    along = np.array([x, y, 0.0]) / max(distance, 1e-9)
    return Measured(odometry=distance, measured=tape, sigma=_scalar_sigma(detail, model, along, tape_sigma))


def check_turns(calibration: Calibration, wheels: WheelSamples, turns: float, mark_sigma: float) -> Measured:
    """Return the angle turned from the first standing to the last, by the wheels and by counting turns to a mark.

    Parameters
    ----------
    calibration, wheels
        As for :func:`check_distance`.
    turns
        Whole turns to the left (negative to the right).
    mark_sigma : rad
        Standard deviation of how well the robot was lined up with the mark.

    Raises
    ------
    CalibError
        As for :func:`check_distance`.
    """
    detail = detail_of(calibration)
    model = _between_standings(calibration, wheels)
    heading = np.array([0.0, 0.0, 1.0])
    return Measured(
        odometry=float(model.displacement[0, 2]),
        measured=2 * np.pi * turns,
        sigma=_scalar_sigma(detail, model, heading, mark_sigma),
    )


def _between_standings(calibration: Calibration, wheels: WheelSamples) -> LegModel:
    """Return the path from the first standing to the last as one leg."""
    stops = find_stops(wheels)
    if len(stops) < 2:
        raise CalibError(
            f"at rest {len(stops)} times",
            source=calibration.robot,
            needed="twice is needed",
            remedy="let the robot stand for two seconds before and after the drive",
        )
    drive = Correspondences(
        robot=calibration.robot,
        image_size=calibration.image_size,
        wheels=wheels,
        stops=(_blind(stops[0]), _blind(stops[-1])),
    )
    if not drive.legs_covered[0]:
        raise CalibError(
            "the wheels' readings have a gap on the way", source=calibration.robot, remedy="record the drive again"
        )
    return odometry(calibration, drive)


def _blind(stop: Stop) -> StopObservation:
    """Return a stop at which nothing was seen."""
    none = np.zeros(0)
    return StopObservation(
        **asdict(stop),
        landmark_ids=none.astype(np.int64),
        p_box=none.reshape(0, 3),
        uv_px=none.reshape(0, 2),
        cov_px2=none.reshape(0, 2, 2),
        frames=0,
    )


def _scalar_sigma(detail: Detail, model: LegModel, along: Array, measured: float) -> float:
    """Return the standard deviation of one combination of a leg's displacement less a measurement."""
    J = along @ model.d_wheels[0]
    wheels = J @ detail.covariance.block(WHEELS) @ J
    return float(np.sqrt(wheels + along @ wheel_noise(detail, model, 0) @ along + measured**2))
