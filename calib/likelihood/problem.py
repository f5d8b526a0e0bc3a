"""The unknowns and the data of the likelihood.

Unknowns that all stops share ("shared") come first: lens, wheels, mounting, floor tilt a drive, further lens
coefficients, the box' shape. Every stop adds five: its pose on the floor ``(x, y, theta)`` and the two errors of its
wheel readings.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.diff_drive import legs_between
from boxcal.calib.geometry.so3_se3 import exp_so3, right_jacobian, rigid, rot_z
from boxcal.calib.likelihood.leg_model import WheelPath, wheel_path
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.target_deformation import BoxShape, box_shape
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import CameraKind, further_names

REPORTED = ("fu", "fv", "cu", "cv", "kr", "rR", "rL", "b", "rx", "ry", "rz", "tx", "ty", "tz")
"""Order of the reported covariance."""
CAMERA, WHEELS, MOUNTING = slice(0, 5), slice(5, 8), slice(8, 14)
PER_STOP = 5
_JITTER = 1e-9
"""Relative; sizes measured with one ruler may have a covariance that cannot be inverted."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """Values of all unknowns.

    Attributes
    ----------
    lens : (5 + extras,)
        fu, fv, cu, cv (px), kr and the lens' further coefficients.
    wheels : (3,), m
        rR, rL, b.
    T_body_cam : (4, 4), m
        The mounting.
    tilt : (D, 2), rad
        Rotation of the floor about the box' x and y, a row for each drive: ``T_box_floor = exp(tilt_x, tilt_y, 0)``.
    shape : (n,)
        Unknowns of the box.
    poses : (P, 3), m and rad
        x, y and heading of the body on the floor, at each stop.
    readings : (P, 2)
        True wheel angle less reading, right and left, in units of ``step / sqrt(12)``.
    """

    lens: Array
    wheels: Array
    T_body_cam: Array
    tilt: Array
    shape: Array
    poses: Array
    readings: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """The data of one robot's drives, stops and legs numbered through.

    Attributes
    ----------
    lens
        Lens model.
    names
        Of the shared unknowns.
    prior : (n,)
        Standard deviations of their priors (zero mean), infinite where there is none.
    prior_information : (n, n)
        Information of the priors.
    box
        Landmarks and their unknowns.
    uv_px : (L, 2)
        Corners seen.
    whiten : (L, 2, 2), 1/px
        Turns a corner's error into unit variance, before the pixel factor.
    corner_starts : (P + 1,)
        First corner of each stop.
    path
        Wheel travel.
    step : rad
        Encoder step.
    drives
        How many drives there are.
    drive : (P,)
        The drive of each stop.
    stop : (P,)
        Its number within the drive's correspondences.
    leg_stop : (N,)
        First stop of each leg; its second is the next.
    """

    lens: CameraKind
    names: tuple[str, ...]
    prior: Array
    prior_information: Array
    box: BoxShape
    uv_px: Array
    whiten: Array
    corner_starts: Ids
    path: WheelPath
    step: float
    drives: int
    drive: Ids
    stop: Ids
    leg_stop: Ids

    @property
    def corner_stop(self) -> Ids:
        """The stop of each corner, (L,)."""
        return np.repeat(np.arange(len(self.drive)), np.diff(self.corner_starts))

    @property
    def extras(self) -> slice:
        """Where the lens' further coefficients stand among the shared unknowns."""
        first = 14 + self.tilt_count
        return slice(first, first + len(further_names(self.lens)))

    @property
    def tilts(self) -> slice:
        """Where the tilts stand among the shared unknowns."""
        return slice(14, 14 + self.tilt_count)

    @property
    def tilt_count(self) -> int:
        """How many tilt angles are unknown."""
        return sum(name.startswith("tilt") for name in self.names)

    @property
    def shapes(self) -> slice:
        """Where the box' unknowns stand among the shared ones."""
        return slice(self.extras.stop, len(self.names))


def build_problem(
    drives: Sequence[Correspondences], kept: Sequence[tuple[int, ...]], options: EstimateOptions, step: float
) -> Problem:
    """Return the data of some stops of some drives, one behind the other.

    Parameters
    ----------
    drives
        What was seen and rolled.
    kept
        Numbers of the stops to use, for each drive (none is allowed); the robot drives through the others.
    options
        Which unknowns there are.
    step : rad
        Encoder step.
    """
    views = [drive.stops[j] for drive, stops in zip(drives, kept, strict=True) for j in stops]
    cov = np.concatenate([v.cov_px2 for v in views])
    names = list(REPORTED)
    prior = [np.inf] * 14
    if options.tilt_sigma > 0:
        for d in range(len(drives)):
            suffix = "" if len(drives) == 1 else f"_{d + 1}"
            names += [f"tilt_x{suffix}", f"tilt_y{suffix}"]
            prior += [options.tilt_sigma] * 2
    names += further_names(options.lens)
    prior += [np.inf] * len(further_names(options.lens))
    box = box_shape(options, np.concatenate([v.landmark_ids for v in views]), np.concatenate([v.p_box for v in views]))
    prior = [*prior, *np.sqrt(np.diag(box.prior))]
    prior_information = np.diag(1 / np.square(prior))
    first = len(names)
    prior_information[first:, first:] = np.linalg.inv(box.prior + _JITTER * np.diag(np.diag(box.prior)))
    counts = [len(stops) for stops in kept]
    drive = np.repeat(np.arange(len(drives)), counts)
    return Problem(
        lens=options.lens,
        names=(*names, *box.names),
        prior=np.array(prior),
        prior_information=prior_information,
        box=box,
        uv_px=np.concatenate([v.uv_px for v in views]),
        whiten=np.linalg.inv(np.linalg.cholesky(cov)),
        corner_starts=np.cumsum([0, *(len(v.landmark_ids) for v in views)]),
        path=wheel_path([legs_between(d, k) for d, k in zip(drives, kept, strict=True) if k]),
        step=step,
        drives=len(drives),
        drive=drive,
        stop=np.concatenate([np.asarray(stops, dtype=np.int64) for stops in kept]),
        leg_stop=np.flatnonzero(drive[:-1] == drive[1:]),
    )


def moved(problem: Problem, state: State, d_shared: Array, d_stops: Array) -> State:
    """Return the state after a step: (n,) of the shared unknowns, (P, 5) of the stops'.

    To first order the mounting moves to ``T_body_cam @ exp_se3(rx, ry, rz, tx, ty, tz)`` and everything else by
    addition. Beyond that, the step keeps straight what the images know well: where the cameras stand and look is linear
    in the step, whatever the mounting's yaw and its place on the robot do, and the poses follow. (Moving poses and
    mounting independently would bend every long step out of the images' narrow valley.)
    """
    m = d_shared[MOUNTING]
    R, t = state.T_body_cam[:3, :3], state.T_body_cam[:3, 3]
    yaw = float(R[2] @ m[:3])  # turn of the mounting about the vertical
    new_R = rot_z(yaw) @ R @ exp_so3(m[:3] - yaw * R[2])
    d_t = R @ m[3:]
    Rz, theta = _headings(state.poses[:, 2]), state.poses[:, 2] + d_stops[:, 2]
    s = (Rz @ t)[:, :2]
    camera = s + (Rz @ d_t)[:, :2] + d_stops[:, :2] + d_stops[:, 2:3] * np.stack([-s[:, 1], s[:, 0]], axis=1)
    xy = state.poses[:, :2] + camera - (_headings(theta) @ (t + d_t))[:, :2]
    tilt = state.tilt
    if problem.tilt_count:
        tilt = tilt + d_shared[problem.tilts].reshape(-1, 2)
    return replace(
        state,
        lens=state.lens + np.concatenate([d_shared[CAMERA], d_shared[problem.extras]]),
        wheels=state.wheels + d_shared[WHEELS],
        T_body_cam=rigid(new_R, t + d_t),
        tilt=tilt,
        shape=state.shape + d_shared[problem.shapes],
        poses=np.concatenate([xy, theta[:, None]], axis=1),
        readings=state.readings + d_stops[:, 3:],
    )


def camera_motions(problem: Problem, state: State) -> tuple[Array, Array, Array, Array]:
    """Return the cameras' poses and how they move, as right perturbations of ``T_box_cam``.

    Returns
    -------
    R_box_cam : (P, 3, 3)
    p_box_cam : (P, 3), m
    by_pose : (P, 6, 3)
        Motion (rotation, translation) by (x, y, theta). The motion by the mounting's perturbation is the identity.
    by_tilt : (P, 6, 2)
        Motion by the drive's tilt.
    """
    F_drive = np.array([exp_so3(np.array([*tilt, 0.0])) for tilt in state.tilt])
    F = F_drive[problem.drive]
    R_m, t_m = state.T_body_cam[:3, :3], state.T_body_cam[:3, 3]
    Rz = _headings(state.poses[:, 2])
    s = Rz @ t_m
    s[:, :2] += state.poses[:, :2]
    Q = Rz @ R_m  # R_floor_cam
    by_pose = np.zeros((len(Rz), 6, 3))
    by_pose[:, 3:, :2] = np.swapaxes(Q, 1, 2)[:, :, :2]
    by_pose[:, :3, 2] = R_m[2]
    by_pose[:, 3:, 2] = R_m.T @ np.array([-t_m[1], t_m[0], 0.0])
    # Tilt: R_box_floor <- R_box_floor exp(beta), beta = J dtilt.
    J = np.array([_exp_derivative(tilt) for tilt in state.tilt])[problem.drive]
    QtJ = np.swapaxes(Q, 1, 2) @ J
    by_tilt = np.concatenate([QtJ, np.swapaxes(Q, 1, 2) @ np.cross(J, s[:, :, None], axis=1)], axis=1)
    return F @ Q, np.einsum("pij,pj->pi", F, s), by_pose, by_tilt


def _headings(theta: Array) -> Array:
    R = np.zeros((len(theta), 3, 3))
    c, s = np.cos(theta), np.sin(theta)
    R[:, 0, 0], R[:, 0, 1], R[:, 1, 0], R[:, 1, 1], R[:, 2, 2] = c, -s, s, c, 1.0
    return R


def _exp_derivative(tilt: Array) -> Array:
    """Return the right derivative of ``exp(tilt_x, tilt_y, 0)`` by the tilt, (3, 2)."""
    return right_jacobian(np.array([*tilt, 0.0]))[:, :2]
