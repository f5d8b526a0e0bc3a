"""Result of the maximum-likelihood estimator."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.leave_one_out import Jackknife
from boxcal.target.arrays import Array, Mask
from boxcal.target.camera.camera_model import CameraModel


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseLevels:
    """Noise levels and their standard deviations.

    Attributes
    ----------
    pixel_factor, pixel_factor_sigma
        How much more corners err than their own standard deviations say (root mean squares, a floor included): above
        1, corners err by more than their frames scatter. The sigma is 0 where the factor was given.
    pixel_px : px
        Standard deviation of a corner's coordinate that results (root mean square over the corners).
    slip, slip_sigma : m/sqrt(m)
        Slip of each wheel. The sigma is 0 where slip was given.
    encoder_step : rad
        0 where the readings show no step.
    """

    pixel_factor: float
    pixel_factor_sigma: float
    pixel_px: float
    slip: float
    slip_sigma: float
    encoder_step: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveEstimate:
    """One drive at the solution; P stops used, P - 1 legs between them.

    Attributes
    ----------
    robot
        As the drive names it.
    stops : (P,)
        Numbers of the stops used, as in the drive.
    T_box_body : (P, 4, 4), m
        Where the robot stood; the body's origin and its x and y axes lie in the floor, but for how the robot leaned and
        sank there.
    pose_cov : (P, 3, 3), m and rad
        Covariance of x, y and heading on the floor.
    tilt : (2,), rad
        Rotation of the floor about the box' x and y axes: ``T_box_floor = exp_so3(tilt_x, tilt_y, 0)``.
    tilt_sigma : (2,), rad
        Its standard deviations; 0 where the tilt is no unknown.
    stop_rms_px : (P,), px
        Root mean square reprojection error (2-D) of the corners used.
    leg_residuals : (P - 1, 3)
        Wheels less poses at the solution, whitened.
    leg_p_values : (P - 1,)
        Chance of a leg that differs as much from what all other data predict.
    leg_used : (P - 1,) bool
        Whether the leg counted.
    """

    robot: str
    stops: tuple[int, ...]
    T_box_body: Array
    pose_cov: Array
    tilt: Array
    tilt_sigma: Array
    stop_rms_px: Array
    leg_residuals: Array
    leg_p_values: Array
    leg_used: Mask


@dataclass(frozen=True, slots=True, kw_only=True)
class FlaggedLeg:
    """A leg whose wheels and images differ by more than noise explains; it was left out.

    Attributes
    ----------
    drive, leg
        Number of the drive, and of the stop that the leg starts from, both from 0 and as in the drive.
    next_stop
        The stop that it ends at.
    t_start_ns, t_end_ns : ns
        From the end of the first stop to the start of the next.
    size_mm, turn_deg
        Wheels less images: distance and turn.
    p_value
        Chance of that without a fault.
    box_moved_mm, box_turned_deg
        Displacement (x, y) and turn of the box, in its own frame, that explains it instead of the robot.
    slip_explains
        Whether a slip of the wheels at one moment of the leg can explain it.
    text
        All of this in words.
    """

    drive: int
    leg: int
    next_stop: int
    t_start_ns: int
    t_end_ns: int
    size_mm: float
    turn_deg: float
    p_value: float
    box_moved_mm: tuple[float, float]
    box_turned_deg: float
    slip_explains: bool
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FlaggedCorner:
    """A corner that lies further off than noise explains; it was left out.

    Attributes
    ----------
    drive, stop
        Numbers from 0, as in the drive.
    landmark_id
        ``4 * tag id + corner``.
    error_px
        Seen less predicted, u and v.
    """

    drive: int
    stop: int
    landmark_id: int
    error_px: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Direction:
    """A combination of parameters that the drive determines badly or not at all.

    Attributes
    ----------
    parameters
        Those that take part, with their component (in natural units: 1 % of a length, 1 mm, 1 mrad), the largest first.
    sigma
        Standard deviation along it in those units; infinite if it is not determined.
    what
        What is not or badly determined, in words.
    advice
        What to drive, or to ask, instead.
    """

    parameters: tuple[tuple[str, float], ...]
    sigma: float
    what: str
    advice: str

    @property
    def text(self) -> str:
        """Both in one line."""
        return f"{self.what}; {self.advice}" if self.advice else self.what


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """The calibration of one robot, with what is known about its errors.

    Attributes
    ----------
    camera
        The camera model, with all its distortion coefficients.
    rR, rL, b : m
        Wheel radii and wheel separation.
    T_body_cam : (4, 4), m
        The camera extrinsics.
    drives
        What is particular to each drive.
    noise
        Noise levels.
    cov : (14, 14)
        Covariance in the order fu, fv, cu, cv (px), kr, rR, rL, b (m), rx, ry, rz (rad), tx, ty, tz (m). Rotation is a
        right perturbation of the camera extrinsics, ``R_body_cam @ exp_so3(rx, ry, rz)``: about the camera's own axes.
        The translation is that of ``t_body_cam`` itself, along the body's axes. What is not determined has infinite
        variance, and NaN covariances.
    odometry_cov : (14, 14), optional
        The same without what changes parameters but not where wheels lead, such as a scrub alike in all turns; None
        where that is ``cov``.
    names, values, cov_all
        All unknowns that the stops share (the 14, tilts, lens coefficients, the box' shape), their values (0 for the
        extrinsics' perturbation) and their covariance, same conventions.
    flagged_legs, flagged_corners
        Faults found.
    directions
        What the drive determines badly or not at all.
    notes
        What the user should know.
    components
        Variance components found.
    jackknife
        Leave-one-out standard deviations beside the likelihood's. Where they are larger beyond chance, ``cov`` is
        enlarged to them, and something is not as the model has it (``jackknife.unexplained``).
    scale_sigma
        Standard deviation, relative, of the size of the target as a whole, which is not in ``cov``: every length
        (radii, wheel separation, translation) is only as good as the print. 0 where the target was measured: then that
        is in ``cov``.
    iterations
        Steps of the solver, all rounds.
    cost
        Weighted sum of squares at the solution.
    log_likelihood
        Of corners and legs at the solution, up to a constant that depends on the data only; for comparing lens models.
    findings
        Causes of what noise does not explain: solved for, or only named.
    """

    camera: CameraModel
    rR: float
    rL: float
    b: float
    T_body_cam: Array
    drives: tuple[DriveEstimate, ...]
    noise: NoiseLevels
    cov: Array
    names: tuple[str, ...]
    values: Array
    cov_all: Array
    flagged_legs: tuple[FlaggedLeg, ...]
    flagged_corners: tuple[FlaggedCorner, ...]
    directions: tuple[Direction, ...]
    notes: tuple[str, ...]
    components: VarianceComponents
    jackknife: Jackknife
    scale_sigma: float
    iterations: int
    cost: float
    log_likelihood: float
    findings: tuple[Finding, ...] = ()
    odometry_cov: Array | None = None

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each reported parameter by name (px, m, rad)."""
        return dict(zip(ORDER, np.sqrt(np.diag(self.cov)).tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """Correlations, (14, 14), in the order of ``cov``."""
        s = np.sqrt(np.diag(self.cov))
        return np.asarray(self.cov / np.outer(s, s))

    @property
    def extra_sigma(self) -> dict[str, float]:
        """Standard deviation of the unknowns beyond the 14 by name."""
        s = np.sqrt(np.diag(self.cov_all))[len(ORDER) :]
        return dict(zip(self.names[len(ORDER) :], s.tolist(), strict=True))
