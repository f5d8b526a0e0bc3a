"""A check drive by the box: where the calibrated wheels lead the robot, against where its camera sees the box."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from scipy.special import chdtrc

from boxcal.calib.check_drive.odometry import detail_of, odometry, wheel_noise
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.reprojection import left_pose_jacobian, move_left, transform
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, rigid, wrap
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import MOUNTING, WHEELS, Detail
from boxcal.calib.results.trajectory import floor_pose
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import project_with_jacobians, unproject

_REFINEMENTS = 10
_STEP = 1e-6
"""Of central differences, rad and m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckedLeg:
    """One leg of a check drive: odometry minus what was seen at its end.

    Attributes
    ----------
    start, end
        Numbers of the stops, from 0.
    rolled : m
        Mean distance that the wheels rolled, both directions counted.
    turned : rad
        Heading change by the wheels, whole turns included.
    error : (3,), m and rad
        Odometry minus vision: forward, to the left, heading; in the robot's axes at the leg's start.
    sigma : (3,), m and rad
        Predicted standard deviations of these.
    chi_square
        Squared error over its predicted covariance; 3 on average where the prediction holds.
    p_value
        Probability of an error at least as large where the prediction holds.
    corner_rms
        Reprojection errors at the leg's ends over their standard deviations (root mean square of the worse stop): about
        1 where the camera is the calibrated one.
    """

    start: int
    end: int
    rolled: float
    turned: float
    error: Array
    sigma: Array
    chi_square: float
    p_value: float
    corner_rms: float


def check_drive(calibration: Calibration, drive: Correspondences) -> tuple[CheckedLeg, ...]:
    """Return how far the odometry of a calibrated robot is off at every stop that saw the box.

    The drive must be another than those that the calibration was made from: the errors of both count as independent.

    Raises
    ------
    CalibError
        If the calibration has no covariance (closed form), or belongs to images of another size.
    """
    detail = detail_of(calibration)
    if drive.image_size != calibration.image_size:
        raise CalibError(
            f"images of {drive.image_size[0]} x {drive.image_size[1]} px, the calibration is for "
            f"{calibration.image_size[0]} x {calibration.image_size[1]}; record as the calibration's log was"
        )
    stops = [_look(calibration, detail, stop) for stop in drive.stops]
    model = odometry(calibration, drive)
    shared = _shared_covariance(calibration, detail)
    out = []
    for i, (a, b) in enumerate(pairwise(stops)):
        seen, by_a, by_b = _displacement(a.pose, b.pose)
        error = model.displacement[i] - seen
        error[2] = wrap(error[2])
        J = np.concatenate([-(by_a @ a.by_camera + by_b @ b.by_camera), model.d_wheels[i]], axis=1)
        cov = J @ shared @ J.T + by_a @ a.cov @ by_a.T + by_b @ b.cov @ by_b.T + wheel_noise(detail, model, i)
        square = float(error @ np.linalg.solve(cov, error))
        out.append(
            CheckedLeg(
                start=i,
                end=i + 1,
                rolled=float(model.rolled[i].mean()),
                turned=float(model.displacement[i, 2]),
                error=error,
                sigma=np.sqrt(np.diag(cov)),
                chi_square=square,
                p_value=float(chdtrc(3, square)),
                corner_rms=max(a.corner_rms, b.corner_rms),
            )
        )
    return tuple(out)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Look:
    """Floor pose (3,) at one stop, its derivatives (3, n + 6) by camera and extrinsics; covariance by noise; fit."""

    pose: Array
    by_camera: Array
    cov: Array
    corner_rms: float


def _look(calibration: Calibration, detail: Detail, stop: StopObservation) -> _Look:
    """Return where the camera says that the robot stood."""
    camera = calibration.camera
    cov_px2 = detail.corner_cov_px2(stop.cov_px2)
    T = _pose(calibration, stop, cov_px2)
    p_cam = transform(T, stop.p_box)
    uv_px, by_camera, by_point = project_with_jacobians(camera.kind, camera.values, p_cam)
    by_pose = by_point @ left_pose_jacobian(p_cam)
    weight = np.linalg.inv(cov_px2)
    normal = np.einsum("lai,lab,lbj->ij", by_pose, weight, by_pose)
    pull = np.einsum("lai,lab,lbj->ij", by_pose, weight, by_camera)

    def at(xi: Array) -> Array:
        """Return the floor pose with the camera moved by xi[:6] and the extrinsics by xi[6:]."""
        change = rigid(exp_so3(xi[6:9]), np.zeros(3))
        T_body_cam = calibration.T_body_cam @ change
        T_body_cam[:3, 3] += xi[9:]
        return floor_pose(inverse(move_left(T, xi[:6])), T_body_cam)

    by_xi = np.stack([(at(e) - at(-e)) / (2 * _STEP) for e in _STEP * np.eye(12)], axis=1)
    pose = at(np.zeros(12))
    off = stop.uv_px - uv_px
    square = float(np.mean(np.einsum("la,lab,lb->l", off, weight, off))) / 2
    return _Look(
        pose=pose,
        by_camera=np.concatenate([-by_xi[:, :6] @ np.linalg.solve(normal, pull), by_xi[:, 6:]], axis=1),
        corner_rms=square**0.5,
        cov=by_xi[:, :6] @ np.linalg.solve(normal, by_xi[:, :6].T) + _effects_covariance(calibration, detail, T, pose),
    )


def _effects_covariance(calibration: Calibration, detail: Detail, T_cam_box: Array, pose: Array) -> Array:
    """Return the covariance (3, 3) of a floor pose by what differs from stop to stop: leaning, and the faces seen.

    A face glued off its place shifts the pose; one that is turned turns it about the box. What two stops have in
    common by seeing the same faces would cancel between them; counting it twice is on the safe side.
    """

    def leaning(lean: Array) -> Array:
        """Return the floor pose of a robot that leans by (2,) rad about its own axes x and y."""
        return floor_pose(
            inverse(T_cam_box), rigid(exp_so3(np.append(lean, 0.0)), np.zeros(3)) @ calibration.T_body_cam
        )

    by_lean = np.stack([(leaning(e) - leaning(-e)) / (2 * _STEP) for e in _STEP * np.eye(2)], axis=1)
    by_turn = np.array([-pose[1], pose[0], 1.0])
    place, turn = detail.effects.get("place_m", 0.0), detail.effects.get("turn_rad", 0.0)
    return np.asarray(
        detail.effects.get("lean_rad", 0.0) ** 2 * by_lean @ by_lean.T
        + np.diag([place**2, place**2, 0.0])
        + turn**2 * np.outer(by_turn, by_turn)
    )


def _pose(calibration: Calibration, stop: StopObservation, cov_px2: Array) -> Array:
    """Return T_cam_box (4, 4), m: least squares over corners of covariances (L, 2, 2), from OpenCV's SQPnP."""
    camera = calibration.camera
    xy = unproject(camera, stop.uv_px)
    seen = np.all(np.isfinite(xy), axis=1)
    _, rvec, tvec = cv2.solvePnP(stop.p_box[seen], xy[seen], np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_SQPNP)
    T = rigid(np.asarray(cv2.Rodrigues(rvec)[0], dtype=np.float64), np.ravel(tvec).astype(np.float64))
    weight = np.linalg.inv(cov_px2)
    for _ in range(_REFINEMENTS):
        p_cam = transform(T, stop.p_box)
        uv, _, by_point = project_with_jacobians(camera.kind, camera.values, p_cam)
        J = by_point @ left_pose_jacobian(p_cam)
        normal = np.einsum("lai,lab,lbj->ij", J, weight, J)
        T = move_left(T, np.linalg.solve(normal, np.einsum("lai,lab,lb->i", J, weight, stop.uv_px - uv)))
    return T


def _displacement(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return pose b in the axes of pose a, (3,), and its derivatives (3, 3) by a and by b."""
    c, s = np.cos(a[2]), np.sin(a[2])
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    out = back @ (b - a)
    by_a = -back.copy()
    by_a[:2, 2] += (out[1], -out[0])
    return out, by_a, back


def _shared_covariance(calibration: Calibration, detail: Detail) -> Array:
    """Return the covariance of (camera, extrinsics, wheels); further distortion coefficients vary with no wheel."""
    camera, wheels = calibration.projection_covariance, detail.covariance.block(WHEELS)
    n = len(camera)
    cov = np.zeros((n + len(WHEELS), n + len(WHEELS)))
    cov[:n, :n], cov[n:, n:] = camera, wheels
    named = [*detail.covariance.names[:5], *MOUNTING]
    rows = [*range(5), *range(n - len(MOUNTING), n)]
    both = detail.covariance.block([*named, *WHEELS])
    cov[np.ix_(rows, range(n, n + len(WHEELS)))] = both[: len(named), len(named) :]
    cov[np.ix_(range(n, n + len(WHEELS)), rows)] = both[len(named) :, : len(named)]
    return cov
