"""Step 1: the camera's intrinsics and its pose at every stop (section 3.1).

Two modes. *Joint*: one set of intrinsics for all stops. *Per stop* (the paper's): every stop calibrated alone and the
intrinsics averaged; a stop that cannot be calibrated alone is left out and named.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from operator import itemgetter

import cv2
import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.backend import backend
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.damped_step import ERROR
from boxcal.calib.four_steps.zhang_init import camera_matrix_guesses, face_homographies
from boxcal.calib.geometry.so3_se3 import exp_se3
from boxcal.detect.correspondences import StopObservation
from boxcal.target.arrays import Array, Ids, Mask
from boxcal.target.camera.camera_model import CameraModel

MIN_LANDMARKS = 6
_ITERATIONS = 100
_FLAT_M2 = 1e-12
"""Sum of squared distances from a plane, m^2, below which landmarks lie in one."""
_FIRST_DAMPING = 1e-6
_LAST = 1e-7
"""A step that promises less than this fraction of the sum of squares is the last, and taken: steps square the error."""
_STOPS_FOR_GUESS = 6
"""How many stops, spread over the drive, the first guess of the camera is taken from."""
_FITS = 0.01
"""A guess whose errors are smaller than this fraction of the image (root mean square) is taken without another one."""
_LANDMARKS_FOR_POSE = 48
"""A first pose is taken from about this many landmarks of a stop; all of them refine it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraStep:
    """Result of step 1: camera model and camera pose at every stop.

    Attributes
    ----------
    camera
        Intrinsics.
    kept
        Numbers of the stops that could be used, ascending.
    T_cam_box : (len(kept), 4, 4), m
        Maps points of the box to the camera, a pose for each kept stop.
    rms_px
        Root mean square of the reprojection errors (2-D, over all landmarks).
    stop_rms_px : (len(kept),), px
        The same for each stop.
    notes
        Stops left out, and why.
    """

    camera: CameraModel
    kept: tuple[int, ...]
    T_cam_box: Array
    rms_px: float
    stop_rms_px: Array
    notes: tuple[str, ...] = ()


def calibrate_camera(
    stops: tuple[StopObservation, ...], image_size: tuple[int, int], mode: CameraMode = CameraMode.JOINT
) -> CameraStep:
    """Return the camera and its poses.

    Parameters
    ----------
    stops
        What each stop saw.
    image_size : px
        Width and height.
    mode
        Joint or per stop.

    Raises
    ------
    CalibError
        If the views do not determine a camera (all faces seen straight on, or no stop can be used).
    """
    return _joint(stops, image_size) if mode is CameraMode.JOINT else _per_stop(stops, image_size)


@lru_cache(maxsize=1)  # views between stops are predicted from the same stops that are calibrated from a moment later
def _joint(stops: tuple[StopObservation, ...], image_size: tuple[int, int]) -> CameraStep:
    kept = tuple(j for j, stop in enumerate(stops) if len(stop.landmark_ids) >= MIN_LANDMARKS)
    notes = tuple(
        f"stop {j + 1}: {len(stop.landmark_ids)} landmarks, {MIN_LANDMARKS} are needed; left out"
        for j, stop in enumerate(stops)
        if j not in kept
    )
    camera, poses = _solve([stops[j] for j in kept], image_size)
    return _step(camera, kept, poses, stops, notes)


def _per_stop(stops: tuple[StopObservation, ...], image_size: tuple[int, int]) -> CameraStep:
    kept, cameras, poses, notes = [], [], [], []
    for j, stop in enumerate(stops):
        faces = np.count_nonzero(np.bincount(stop.faces) >= MIN_LANDMARKS)
        if faces < 2:
            notes.append(f"stop {j + 1}: its landmarks lie in one plane, two faces are needed per stop; left out")
            continue
        try:
            camera, (T,) = _solve([stop], image_size)
        except CalibError as error:
            notes.append(f"stop {j + 1}: {error}; left out")
            continue
        kept.append(j)
        cameras.append((camera.fu, camera.fv, camera.cu, camera.cv, camera.kr))
        poses.append(T)
    if not kept:
        raise CalibError(
            f"none of {len(stops)} stops can be calibrated alone: a stop needs two faces of the box in view",
            remedy="add such stops, or calibrate all stops jointly",
        )
    fu, fv, cu, cv, kr = (float(v) for v in np.mean(cameras, axis=0))
    return _step(CameraModel(fu=fu, fv=fv, cu=cu, cv=cv, kr=kr), tuple(kept), np.array(poses), stops, tuple(notes))


def _step(
    camera: CameraModel, kept: tuple[int, ...], poses: Array, stops: tuple[StopObservation, ...], notes: tuple[str, ...]
) -> CameraStep:
    views = _Views.of([stops[j] for j in kept])
    squares = views.sums(camera, poses)[:, ERROR, ERROR]
    return CameraStep(
        camera=camera,
        kept=kept,
        T_cam_box=poses,
        rms_px=float(np.sqrt(np.sum(squares) / len(views.uv_px))),
        stop_rms_px=np.sqrt(squares / np.diff(views.starts)),
        notes=notes,
    )


def _solve(stops: list[StopObservation], image_size: tuple[int, int]) -> tuple[CameraModel, Array]:
    """Return the camera and poses (P, 4, 4) that minimise the reprojection error, from scratch."""
    rows = np.unique(np.linspace(0, len(stops) - 1, min(len(stops), _STOPS_FOR_GUESS)).round().astype(int))
    some = [stops[j] for j in rows]
    homographies = face_homographies(some)
    if not homographies:
        raise CalibError("no face of the box shows two tags at once: a larger or nearer view of the box is needed")
    guesses = [
        CameraModel(fu=K[0, 0], fv=K[1, 1], cu=K[0, 2], cv=K[1, 2], kr=0.0)
        for K in camera_matrix_guesses(homographies, image_size)
    ]
    judges = rows[::2]
    views = _Views.of([stops[j] for j in judges])
    tried: list[tuple[float, CameraModel, Array]] = []
    for guess in guesses:
        found = located(guess, [stops[j] for j in judges])
        tried.append((_cost(views.sums(guess, found)), guess, found))
        if tried[-1][0] < len(views.uv_px) * (_FITS * max(image_size)) ** 2:
            break
    _, guess, found = min(tried, key=itemgetter(0))
    poses, rest = np.empty((len(stops), 4, 4)), np.delete(np.arange(len(stops)), judges)
    poses[judges] = found
    if len(rest):
        poses[rest] = located(guess, [stops[j] for j in rest])
    camera, poses, _ = minimise_reprojection(guess, poses, stops)
    return camera, poses


def located(camera: CameraModel, stops: Sequence[StopObservation]) -> Array:
    """Return the camera's poses at some stops, ``T_cam_box`` (P, 4, 4), for known intrinsics (OpenCV's PnP).

    A first guess: of many landmarks of a stop, some.
    """
    K, dist, views = camera.K, np.array([camera.kr, 0.0, 0.0, 0.0]), _Views.of(stops)
    flat = _flat(views)
    found = []
    for (i, j), plane in zip(pairwise(views.starts.tolist()), flat.tolist(), strict=True):
        method = cv2.SOLVEPNP_IPPE if plane else cv2.SOLVEPNP_SQPNP
        some = slice(i, j, 1 + (j - i) // _LANDMARKS_FOR_POSE)
        try:
            p_box, uv_px = (np.ascontiguousarray(part[some]) for part in (views.p_box, views.uv_px))
            count, rvecs, tvecs, errors = cv2.solvePnPGeneric(p_box, uv_px, K, dist, flags=method)
        except cv2.error as error:  # they lie so close to one another that its numerics refuse them
            raise _unexplained() from error
        if not count:
            raise _unexplained()
        best = int(np.argmin(errors)) if count > 1 else 0
        found += [rvecs[best], tvecs[best]]
    return exp_se3(np.asarray(np.concatenate(found), dtype=np.float64).reshape(-1, 6))


def _flat(views: "_Views") -> Mask:
    """Return which views (P,) show landmarks of one plane."""
    counts, first = np.diff(views.starts), views.starts[:-1]
    x, y, z = (views.p_box - np.repeat(np.add.reduceat(views.p_box, first) / counts[:, None], counts, axis=0)).T
    xx, xy, xz, yy, yz, zz = np.add.reduceat([x * x, x * y, x * z, y * y, y * z, z * z], first, axis=1)
    scatter = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.asarray(np.linalg.eigvalsh(np.moveaxis(scatter, 2, 0))[:, 0] < _FLAT_M2)


def _unexplained() -> CalibError:
    return CalibError("no camera pose explains a stop's landmarks", remedy="are they the corners of this target?")


def minimise_reprojection(
    camera: CameraModel, poses: Array, stops: Sequence[StopObservation]
) -> tuple[CameraModel, Array, float]:
    """Return the intrinsics, poses (P, 4, 4) and sum of squares (px^2) of the least squares reprojection fit.

    Levenberg-Marquardt with the poses eliminated (Schur complement), so that the cost is linear in the stops.
    """
    lam, compute = _FIRST_DAMPING, backend()
    views = _Views.of(stops)
    sums = views.sums(camera, poses)
    cost = _cost(sums)
    for _ in range(_ITERATIONS):
        d_camera, trial_poses, promised = compute.damped_step(sums, lam, poses)
        trial_camera = CameraModel.from_values(camera.kind, camera.values + d_camera)
        if promised < _LAST * cost:
            return trial_camera, trial_poses, cost - promised
        trial = views.sums(trial_camera, trial_poses)
        if _cost(trial) < cost:
            camera, poses, sums, cost = trial_camera, trial_poses, trial, _cost(trial)
            lam = max(lam / 10, 1e-12)
        else:
            lam *= 10
            if lam > 1e6:
                break
    return camera, poses, cost


def _cost(sums: Array) -> float:
    """Return the sum of squared errors, px^2, of views' sums (P, 12, 12)."""
    return float(sums[:, ERROR, ERROR].sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Views:
    """Landmarks of P stops one behind the other: where they are on the box and in the images, and whose they are."""

    p_box: Array  # (L, 3)
    uv_px: Array  # (L, 2)
    starts: Ids  # (P + 1,)

    @classmethod
    def of(cls, stops: Sequence[StopObservation]) -> "_Views":
        return cls(
            p_box=np.concatenate([stop.p_box for stop in stops]),
            uv_px=np.concatenate([stop.uv_px for stop in stops]),
            starts=np.cumsum([0, *(len(stop.landmark_ids) for stop in stops)]),
        )

    def sums(self, camera: CameraModel, poses: Array) -> Array:
        """Return the sums of derivatives and errors of each view, (P, 12, 12); see :func:`reprojection_sums`."""
        return backend().reprojection_sums(camera.values, poses, self.p_box, self.uv_px, self.starts)
