"""Initial guess of the likelihood from consecutive stops, robust against slipped legs.

The four steps weigh a long path like a short one and take every pair of stops; strong slip, a lifted robot or a moved
box spoils many of their pairs. Between *consecutive* stops a fault touches one leg. Camera poses are taken as they are;
wheels and extrinsics come from the paper's linear equations (eqs. 17 and 31), from couples of legs first, then from all
of them, weighted by distance and by how well they fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.four_steps.step1_camera import MIN_LANDMARKS, calibrate_camera, located
from boxcal.calib.four_steps.step2_heading import MAX_CONDITION, solve_heading
from boxcal.calib.four_steps.step4_mounting import solve_mounting, upright_translations
from boxcal.calib.geometry.diff_drive import dead_reckoned, legs_between, pair_displacements, unit_path
from boxcal.calib.geometry.so3_se3 import inverse, rigid, rot_y, rot_z, wrap
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.leg_residuals import leg_covariance, leg_residuals
from boxcal.calib.likelihood.outliers import most_rejected
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State, resting
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import CameraModel, first_values

_COUPLES = 300
_ROUNDS = 10
_TRIED, _CANDIDATES = 20, 5
_NEAR, _MANY_LEGS, _KEPT = 50.0, 12, 3
"""Candidates whose misfit (a variance) comes this near the best are tried too, where there are few legs."""
_ALIKE = 0.3
"""How unlike the radii of a robot's two wheels are thought to be, as a logarithm; judges the start only."""
_WINDINGS = np.array([(k, m) for k in (-1, 0, 1) for m in (-1, 0, 1)], dtype=np.float64)
_NO_MOUNTING = "the moves do not determine the mounting; add legs that both turn and drive on"
_MIN_RANK_RATIO = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraStart:
    """Camera and its poses, all drives one behind the other.

    Attributes
    ----------
    camera
        Intrinsics.
    kept
        Stops used, for each drive.
    T_cam_box : (P, 4, 4), m
        Poses.
    """

    camera: CameraModel
    kept: tuple[tuple[int, ...], ...]
    T_cam_box: Array

    def only(self, kept: Sequence[tuple[int, ...]]) -> "CameraStart":
        """Return the start for some of its stops."""
        known = [(d, j) for d, stops in enumerate(self.kept) for j in stops]
        rows = [known.index((d, j)) for d, stops in enumerate(kept) for j in stops]
        return CameraStart(camera=self.camera, kept=tuple(kept), T_cam_box=self.T_cam_box[rows])


def camera_start(drives: Sequence[Correspondences], start: Sequence[FourSteps] | FourSteps | None) -> CameraStart:
    """Return camera poses from the four steps; a drive that has none is located with the first drive's camera.

    Raises
    ------
    CalibError
        If there is not one start for each drive, one for all, or none; or if no camera can be found.
    """
    if start is None:
        step = calibrate_camera(drives[0].stops, drives[0].image_size)
        cameras = [step]
    else:
        cameras = [s.camera for s in ([start] if isinstance(start, FourSteps) else start)]
    if len(cameras) not in {1, len(drives)}:
        raise CalibError(f"{len(cameras)} starts for {len(drives)} drives: one for each, or one for all, is needed")
    kept = [cameras[0].kept]
    poses = [cameras[0].T_cam_box]
    for k, drive in enumerate(drives[1:], 1):
        if k < len(cameras):
            kept.append(cameras[k].kept)
            poses.append(cameras[k].T_cam_box)
        else:
            stops = tuple(j for j, stop in enumerate(drive.stops) if len(stop.landmark_ids) >= MIN_LANDMARKS)
            if not stops:
                raise CalibError(
                    f"drive {k + 1} ({drive.robot}): no stop shows {MIN_LANDMARKS} landmarks; leave it out"
                )
            kept.append(stops)
            poses.append(located(cameras[0].camera, [drive.stops[j] for j in stops]))
    return CameraStart(camera=cameras[0].camera, kept=tuple(kept), T_cam_box=np.concatenate(poses))


def first_states(problem: Problem, drives: Sequence[Correspondences], camera: CameraStart) -> list[State]:
    """Return the states to start from, the most promising first.

    Few legs leave several phase ambiguities of the turns open: each candidate is judged by its legs, positions
    included, and those that come near the best are kept; the likelihood decides among them.

    Raises
    ------
    CalibError
        If the moves do not determine wheels and extrinsics: what to add.
    """
    T_box_cam = inverse(camera.T_cam_box)
    n = T_box_cam[:, 2, :3].mean(axis=0)  # the box' vertical, in the camera
    n /= np.linalg.norm(n)
    sin_a2 = float(np.hypot(n[0], n[1]))
    a2, a3 = float(np.arctan2(sin_a2, n[2])), float(np.arctan2(n[1], -n[0])) if sin_a2 > 1e-4 else 0.0
    upright = rot_y(a2) @ rot_z(a3)
    M = T_box_cam[:, :3, :3] @ upright.T
    psi = np.arctan2(M[:, 1, 0] - M[:, 0, 1], M[:, 0, 0] + M[:, 1, 1])
    i = problem.leg_stop
    turn = wrap(psi[i + 1] - psi[i])
    c, s = np.cos(psi[i]), np.sin(psi[i])
    d = T_box_cam[i + 1, :2, 3] - T_box_cam[i, :2, 3]
    u = np.stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]], axis=1)
    k = camera.camera
    radial = np.array([k.fu, k.fv, k.cu, k.cv, k.kr])
    found: list[tuple[float, State]] = []
    for aR, aL in _headings(turn, problem):
        if len(i) == 2 and len(drives) == 1:  # nothing to be robust with
            x, y = np.triu_indices(3, 1)
            step = solve_mounting(
                beta=pair_displacements(*unit_path(legs_between(drives[0], camera.kept[0]), aR, aL)),
                theta=wrap(psi[x] - psi[y]),
                u=upright_translations(camera.T_cam_box, a2, a3),
                aR=aR,
                aL=aL,
            )
            rL, tx, ty, a1 = step.rL, step.tx, step.ty, step.a1
        else:
            rL, tx, ty, a1 = _planar(_displacements(problem, aR, aL), turn, u, aR=aR, aL=aL, size=_rolled(problem))
        rR = -aR / aL * rL
        theta = psi - a1
        ct, st = np.cos(theta), np.sin(theta)
        xy = T_box_cam[:, :2, 3] - np.stack([ct * tx - st * ty, st * tx + ct * ty], axis=1)
        state = resting(
            problem,
            lens=first_values(problem.lens, radial),
            wheels=np.array([rR, rL, rR / aR]),
            T_body_cam=rigid(rot_z(a1) @ upright, np.array([tx, ty, float(T_box_cam[:, 2, 3].mean())])),
            poses=np.concatenate([xy, theta[:, None]], axis=1),
        )
        found.append((_misfit(problem, state), state))
    if not found:
        raise CalibError("no radii and wheelbase explain the turns between the stops; are the wheels' signs right?")
    found.sort(key=lambda f: f[0])
    near = _NEAR if len(i) < _MANY_LEGS else 1.0
    return [state for misfit, state in found if misfit <= near * found[0][0]][:_KEPT]


def _misfit(problem: Problem, state: State) -> float:
    """Return how badly the legs fit, the worst of them left aside; wheels that are not alike count as a misfit too."""
    legs = leg_residuals(problem, state, Columns())
    unit = leg_covariance(problem, legs.model, np.array(1.0))
    square = np.sort(np.einsum("ni,nij,nj->n", legs.residual, np.linalg.inv(unit), legs.residual))
    fitting = float(np.mean(square[: len(square) - most_rejected(len(square))]))
    size = float(np.exp(np.mean(np.linalg.slogdet(unit)[1]) / 3))  # wheels that explain all by being large do not win
    return fitting * size * (1 + (float(np.log(state.wheels[0] / state.wheels[1])) / _ALIKE) ** 2)


def _rolled(problem: Problem) -> Array:
    """Return how far the wheels turned on each leg, (N,), rad, both together."""
    right, left = np.abs(problem.path.dphi).T
    return np.asarray(np.add.reduceat(right + left, problem.path.starts) + 1e-9)


def _couples(count: int, size: Array) -> tuple[Ids, Ids]:
    """Return couples of legs, those that moved least first, at most ``_COUPLES``."""
    order = np.argsort(size, kind="stable")
    i, j = np.triu_indices(min(count, 40), 1)
    pick = np.argsort(i + j, kind="stable")[:_COUPLES]
    return order[i[pick]], order[j[pick]]


def _headings(turn: Array, problem: Problem) -> list[tuple[float, float]]:
    """Return candidates of (aR, aL) from the turns of the legs, modulo 2 pi, the most promising first."""
    phi = np.add.reduceat(problem.path.dphi, problem.path.starts)
    size = _rolled(problem)
    singular = np.linalg.svd(phi, compute_uv=False)
    if len(phi) < 2 or singular[1] * MAX_CONDITION < singular[0]:
        solve_heading(turn, phi, moves=len(phi))  # says what is missing
        raise CalibError(f"{len(phi)} legs between stops, at least 2 that differ are needed; add stops")
    if len(phi) == 2:  # any whole turns fit two legs exactly: the four steps' rule decides
        step = solve_heading(np.append(turn, turn.sum()), np.vstack([phi, phi.sum(axis=0)]), moves=2)
        return [(step.aR, step.aL)]
    i, j = _couples(len(phi), size)
    pairs = phi[np.stack([i, j], axis=1)]
    det, lengths = np.abs(np.linalg.det(pairs)), np.linalg.norm(pairs, axis=2)
    good = det > 1e-2 * lengths[:, 0] * lengths[:, 1]
    if not np.any(good):
        good = det > 0
    turns = turn[np.stack([i, j], axis=1)][good][:, None, :] + 2 * np.pi * _WINDINGS
    found = (turns @ np.swapaxes(np.linalg.inv(pairs[good]), 1, 2)).reshape(-1, 2)
    found = found[(found[:, 0] > 0) & (found[:, 1] < 0)]
    if not len(found):
        solve_heading(turn, phi, moves=len(phi))  # says which wheel is reversed
        return []
    scale = np.sqrt(size)
    score = np.sum(np.sqrt(np.abs(wrap(turn - found @ phi.T)) / scale), axis=1)
    score *= 1 + np.abs(np.log(-found[:, 0] / found[:, 1]))
    out: list[tuple[float, float]] = []
    for a in _settled(found[np.argsort(score, kind="stable")[:_TRIED]], turn, phi, scale):
        fresh = all(abs(a[0] / o[0] - 1) + abs(a[1] / o[1] - 1) > 0.02 for o in out)
        if a[0] > 0 > a[1] and fresh and len(out) < _CANDIDATES:
            out.append((float(a[0]), float(a[1])))
    return out


def _settled(a: Array, turn: Array, phi: Array, scale: Array) -> Array:
    """Return (aR, aL) with the least absolute residuals of all legs near each of some first values, (C, 2)."""
    squares = (phi[:, :, None] * phi[:, None, :]).reshape(-1, 4)
    for _ in range(_ROUNDS):
        r = wrap(turn - a @ phi.T)
        size = np.abs(r) / scale
        least = 0.3 * _median(size)[:, None] + 1e-12
        w2 = 1 / (np.maximum(size, least) * scale**2)
        information = (w2 @ squares).reshape(-1, 2, 2)
        information += 1e-14 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(2)  # one leg may decide
        a = a + np.linalg.solve(information, ((w2 * r) @ phi)[..., None])[..., 0]
    return a


def _median(values: Array) -> Array:
    """Return the middle value of each row (the upper one of two): a tenth of the time of numpy's on few values."""
    middle = values.shape[1] // 2
    return np.asarray(np.partition(values, middle, axis=1)[:, middle])


def _displacements(problem: Problem, aR: float, aL: float) -> Array:
    """Return where each leg ends in the body frame of its start, (N, 2), in units of rL (eq. 28)."""
    dphi_R, dphi_L = problem.path.dphi.T
    xy, heading = dead_reckoned(dphi_R, dphi_L, aR, aL)  # as if each leg began where the one before ended
    d = np.diff(xy[np.append(problem.path.starts, len(problem.path.dphi))], axis=0)
    c, s = np.cos(heading[problem.path.starts]), np.sin(heading[problem.path.starts])
    return np.stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]], axis=1)


def _planar(
    beta: Array, turn: Array, u: Array, *, aR: float, aL: float, size: Array
) -> tuple[float, float, float, float]:
    """Return rL, tx, ty, a1: ``beta rL + (R(turn) - I) t - cos a1 u - sin a1 perp(u) = 0`` for every leg."""
    c, s, one = np.cos(turn), np.sin(turn), np.ones_like(turn)
    rows = (
        np.stack(
            [
                np.stack([beta[:, 0], c - one, -s, -u[:, 0], u[:, 1]], axis=1),
                np.stack([beta[:, 1], s, c - one, -u[:, 1], -u[:, 0]], axis=1),
            ],
            axis=1,
        )
        / np.sqrt(size)[:, None, None]
    )
    singular = np.linalg.svd(rows.reshape(-1, 5), compute_uv=False)
    if len(singular) < 4 or singular[3] < _MIN_RANK_RATIO * singular[2]:
        solve_mounting(beta=beta, theta=-turn, u=-u, aR=aR, aL=aL)  # says what is missing
        raise CalibError(_NO_MOUNTING)
    i, j = _couples(len(turn), -size)
    four = np.concatenate([rows[i], rows[j]], axis=1)
    found = np.linalg.qr(np.swapaxes(four, 1, 2), mode="complete")[0][:, :, -1]  # what the four leave
    found = found[np.hypot(found[:, 3], found[:, 4]) > 1e-6]
    if not len(found):
        raise CalibError(_NO_MOUNTING)
    found /= np.hypot(found[:, 3], found[:, 4])[:, None]
    left = rows @ found.T  # (N, 2, H)
    score = np.sum((left[:, 0] ** 2 + left[:, 1] ** 2) ** 0.25, axis=0)
    v = found[int(np.argmin(score))]
    for _ in range(_ROUNDS):
        r = np.linalg.norm(rows @ v, axis=1)
        w = np.sqrt(1 / np.maximum(r, 0.3 * _median(r[None]) + 1e-12))
        v = np.linalg.svd((rows * w[:, None, None]).reshape(-1, 5), full_matrices=False)[2][-1]
        v = v / np.hypot(v[3], v[4])
    v = v if v[0] > 0 else -v
    return float(v[0]), float(v[1]), float(v[2]), float(np.arctan2(v[4], v[3]))
