"""The box as it was built, estimated from what all stops show of it, so that its tags are measured again as they lie.

An image alone cannot tell a box that is not as described from a lens: the fit takes up the one with the other, tags
are aligned on charts of a lens that is not there, and corners of a face come out displaced alike, of which no
covariance knows. Two faces printed at 97 % are displaced by .01 px, three times their errors, with a tenth of their
tags lost. All stops together separate the two: one camera for all, a pose for each, and for each face its print's
size both ways and its place. That is a rough bundle adjustment (corners are good to some .02 px) for the detector
alone; the calibration has its own model of the box.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from boxcal.detect.alignment.box_pose import LEAST_SIGMA_PX, CameraPrior, fit_box, unknown_deviation
from boxcal.detect.alignment.box_refinement import CAMERA, FITTED, Tangent, moved_by
from boxcal.detect.alignment.expected_tags import ExpectedTags
from boxcal.detect.alignment.tag_patterns import Index
from boxcal.detect.image.order_statistics import median
from boxcal.detect.tags.box_shape import SHAPE, by_shape, shaped
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, FACES, Target

OF_ALL, ACROSS = 0.05, 0.01
"""Standard deviations of the size of all prints, and of that across against that up."""
OF_EACH = np.array([0.01, 0.01, 1.5e-3, 1.5e-3, 1.5e-3, 5e-3, 5e-3, 5e-3, 1e-3])
"""Standard deviations of what each face has besides, 1, m and rad."""
NEAR = 1e-4
"""Distance, m, within which nine tenths of the landmarks lie of a box that is as described. Boxes made by hand with
care have .2 to .5 mm, prints at 97 % .8 mm and more; exact ones .02 mm (benchmarks/printed.py)."""
SURELY, BETTER = 0.25, 0.5
"""A box is believed from which landmarks lie within this fraction of that distance: with the first, at once; with the
second, after prints of other sizes were tried to start from."""
_KNOWN = 0.1
"""Initial deviation of a camera estimated from all stops, over that of an unknown one."""
SIZES = (1.0, 0.97, 1.03, 0.94, 1.06, 0.91, 1.09)
"""Sizes of all prints to start from."""
_SIGMA_PX, _FAR_PX = 0.05, 3.0
_ROUGH_PX = 0.2
"""Deviation of corners when the box as described is fitted: with less, cameras compete for what is the box's."""
_ITERATIONS, _DONE = 12, 0.02
"""Steps end when the last one has lessened the sum of squares by less than this fraction of it."""
_LEAST_TAGS, _LEAST_STOPS, _MOST_STOPS = 8, 3, 10
"""Tags that a stop shows at least, and stops, those with the most tags beside their main face, from which the box is
estimated."""
_SOME = slice(None, None, 2)
"""Corners of a tag that are looked at."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _View:
    """Tags of one stop: rows in the table (N,), and where their corners are seen, (N, 4, 2) px."""

    rows: Index
    uv: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Points:
    """Landmarks of all views, those of a view together: where they are seen, (P, 2) px, and rows in the table (P,).

    ``of_view`` are the places of each view's among them, ``corner`` (P,) which corners of their tags they are.
    """

    uv: Array
    rows: Index
    corner: Index
    of_view: tuple[slice, ...]

    def in_camera(self, corners: Array, T_cam_box: Sequence[Array]) -> Array:
        """Return them before the camera, (P, 3) m, from a table (T, 4, 3) and the poses of the box."""
        p = corners[self.rows, self.corner]
        moved = [p[at] @ T[:3, :3].T + T[:3, 3] for at, T in zip(self.of_view, T_cam_box, strict=True)]
        return np.concatenate(moved)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """A camera (focal length and lens), the poses of the box before it, and the faces' shape (FACES, 9)."""

    focal_px: float
    lens: Array
    T_cam_box: tuple[Array, ...]
    shape: Array

    def tangent(self, target: Target, points: _Points) -> tuple[Tangent, Array]:
        """Return landmarks beside where they are seen, and their depths (P,), m."""
        corners = shaped(target, self.shape).tag_corners if self.shape.any() else target.tag_corners
        p_cam = points.in_camera(corners, self.T_cam_box)
        return Tangent(self.focal_px, self.lens, p_cam, points.uv), p_cam[:, 2]

    def apart(self, target: Target, points: _Points) -> float:
        """Return within which distance, m, nine tenths of the landmarks lie of where they are seen, at their depth."""
        tangent, depth = self.tangent(target, points)
        return float(np.quantile(np.hypot(*tangent.off) * np.abs(depth) / self.focal_px, 0.9))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BuiltBox:
    """A box as it was built, and the camera estimated from all stops together.

    Attributes
    ----------
    target
        The box with its landmarks where the stops show them.
    camera
        The camera before which they do, to begin with.
    """

    target: Target
    camera: CameraPrior

    def expected(self, landmark_ids: Ids, uv_px: Array, image_size: tuple[int, int]) -> ExpectedTags:
        """Return the tags that a stop should show which showed landmarks (4 N,) at (4 N, 2) px."""
        target = self.target
        view = _view(target, landmark_ids, uv_px)
        fit = fit_box(target, view.rows, view.uv, image_size=image_size, sigma_px=LEAST_SIGMA_PX, camera=self.camera)
        facing = fit.faces_camera(target)
        uv, _ = fit.predict(target.tag_corners[facing].reshape(-1, 3))
        return ExpectedTags(ids=np.asarray(target.tag_ids)[facing], corners_px=uv.reshape(-1, CORNERS, 2))


def built_box(
    target: Target, stops: Sequence[tuple[Ids, Array]], image_size: tuple[int, int], camera: CameraPrior
) -> BuiltBox | None:
    """Return the box with its landmarks where the stops show them, or None if they are near enough as described.

    Parameters
    ----------
    target
        The box with which the stops were measured.
    stops
        Landmarks (4 N,) of each stop, those of a tag together, and where they are seen, (4 N, 2) px.
    image_size
        (width, height), px.
    camera
        What is known of the camera from the stops.
    """
    views = _most_informative(target, stops)
    if len(views) < _LEAST_STOPS:
        return None
    points, unsure = _points(views), replace(camera, deviation=unknown_deviation(image_size))
    start, _ = _started(target, views, image_size, unsure, 1.0, _ROUGH_PX)
    described = _converged(target, points, start, unsure)
    apart = described.apart(target, points)
    if apart < NEAR:
        return None
    fit = _converged(target, points, described, unsure, shape_free=True)
    if not fit.apart(target, points) < SURELY * apart:
        starts = [_started(target, views, image_size, unsure, size, _SIGMA_PX) for size in SIZES]
        start = _converged(target, points, min(starts, key=lambda found: found[1])[0], unsure)
        fit = _converged(target, points, start, unsure, shape_free=True)
        if not fit.apart(target, points) < BETTER * apart:
            return None
    camera = CameraPrior(focal_px=fit.focal_px, lens=fit.lens, deviation=unsure.deviation * _KNOWN)
    return BuiltBox(target=shaped(target, fit.shape), camera=camera)


def _most_informative(target: Target, stops: Sequence[tuple[Ids, Array]]) -> list[_View]:
    """Return the most informative stops, by the tags on all faces but the one that shows most."""
    views, beside = [], []
    for landmark_ids, uv in stops:
        if len(landmark_ids) < CORNERS * _LEAST_TAGS or len(landmark_ids) % CORNERS:
            continue
        view = _view(target, landmark_ids, uv)
        counts = np.bincount(target.tag_faces[view.rows], minlength=FACES)
        views.append(view)
        beside.append(int(counts.sum() - counts.max()))
    return [views[k] for k in np.argsort(-np.array(beside), kind="stable")[:_MOST_STOPS]]


def _view(target: Target, landmark_ids: Ids, uv_px: Array) -> _View:
    """Return landmarks (4 N,) seen at (4 N, 2) px, those of a tag together, by their tags."""
    rows = np.array([target.row_of(int(tag)) for tag in landmark_ids[::CORNERS] // CORNERS], dtype=np.int64)
    return _View(rows=rows, uv=uv_px.reshape(-1, CORNERS, 2))


def _points(views: Sequence[_View]) -> _Points:
    """Return the landmarks of views that are looked at."""
    corners = np.arange(CORNERS)[_SOME]
    ends = len(corners) * np.cumsum([0, *(len(view.rows) for view in views)])
    rows = np.concatenate([view.rows for view in views])
    return _Points(
        uv=np.concatenate([view.uv[:, _SOME].reshape(-1, 2) for view in views]),
        rows=np.repeat(rows, len(corners)),
        corner=np.tile(corners, len(rows)),
        of_view=tuple(slice(a, b) for a, b in pairwise(ends.tolist())),
    )


def _started(  # noqa: PLR0917 - a view's fit and its start
    target: Target,
    views: Sequence[_View],
    image_size: tuple[int, int],
    camera: CameraPrior,
    size: float,
    sigma_px: float,
) -> tuple[_Fit, float]:
    """Return the box with prints of one size as each view sees it by itself, and the mean deviation there, px.

    The camera is that of the view which determines its focal length best.
    """
    shape = np.zeros((FACES, SHAPE))
    shape[:, :2] = size - 1
    box = shaped(target, shape)
    fits = [fit_box(box, view.rows, view.uv, image_size=image_size, sigma_px=sigma_px, camera=camera) for view in views]
    best = min(fits, key=lambda fit: fit.camera(max(image_size)).deviation[0])
    start = _Fit(focal_px=best.focal_px, lens=best.lens, T_cam_box=tuple(fit.T_cam_box for fit in fits), shape=shape)
    return start, float(np.mean([min(median(fit.off_px), _FAR_PX) for fit in fits]))


def _converged(target: Target, points: _Points, start: _Fit, camera: CameraPrior, *, shape_free: bool = False) -> _Fit:
    """Return the fit of camera and poses, and of the faces' shape where it is free, by Levenberg-Marquardt steps."""
    prior = _prior(camera, shape_free=shape_free)
    kept = new = start
    cost, damping = np.inf, 1e-4
    for _ in range(_ITERATIONS):
        after, now = _step(target, points, new, prior, damping)
        if now > cost:
            damping *= 10
            new, _ = _step(target, points, kept, prior, damping)
            continue
        done = cost - now < _DONE * now
        kept, cost, new, damping = new, now, after, 0.1 * damping
        if done:
            break
    return kept


def _prior(camera: CameraPrior, *, shape_free: bool) -> tuple[Array, Array]:
    """Return what is expected of the camera, (10,), or of it and the shape, (46,), and its information in 1 / px^2."""
    cov = np.diag(camera.deviation**2)
    expected = camera.expected
    if shape_free:
        common = np.zeros((SHAPE, SHAPE))
        common[:2, :2] = OF_ALL**2 + ACROSS**2 / 4 * np.array([[1, -1], [-1, 1]])
        faces = np.kron(np.eye(FACES), np.diag(OF_EACH**2)) + np.kron(np.ones((FACES, FACES)), common)
        none = np.zeros((CAMERA, FACES * SHAPE))
        cov, expected = np.block([[cov, none], [none.T, faces]]), np.append(expected, np.zeros(FACES * SHAPE))
    return expected, np.asarray(_SIGMA_PX**2 * np.linalg.inv(cov), dtype=np.float64)


def _step(target: Target, points: _Points, fit: _Fit, prior: tuple[Array, Array], damping: float) -> tuple[_Fit, float]:
    """Return the fit after a damped step, poses eliminated, and the robust sum of squares before it, px^2."""
    expected, information = prior
    n = len(expected)
    tangent, _ = fit.tangent(target, points)
    off2 = np.sum(tangent.off**2, axis=0)
    scale = 3 * max(_SIGMA_PX, 1.2 * median(np.sqrt(off2)))
    root = np.sqrt(np.where(tangent.before, 1 / (1 + off2 / scale**2), 0.0))
    away = np.concatenate([[np.log(fit.focal_px)], fit.lens[FITTED], fit.shape.ravel()])[:n] - expected
    A, g, own = information.copy(), -information @ away, []
    cost = float(scale**2 * np.log1p(off2 / scale**2).sum() - g @ away)
    J, r = root * tangent.jacobian(), root * tangent.off
    shared = (
        J[:CAMERA] if n == CAMERA else np.concatenate([J[:CAMERA], _by_faces(target, points, fit, J[CAMERA + 3 :])])
    )
    for at in points.of_view:
        S, p, r_at = shared[..., at].reshape(n, -1), J[CAMERA:, :, at].reshape(6, -1), r[:, at].ravel()
        normal = p @ p.T
        both = np.linalg.solve(normal + np.diag(damping * np.diag(normal) + 1e-9), p @ np.column_stack([S.T, r_at]))
        by_shared, by_rest = both[:, :n], both[:, n]
        across = S @ p.T
        A += S @ S.T - across @ by_shared
        g += S @ r_at - across @ by_rest
        own.append((by_rest, by_shared))
    step = np.linalg.solve(A + damping * np.diag(np.diag(A)), g)
    moved = [
        moved_by((fit.focal_px, fit.lens, T), np.concatenate([step[:CAMERA], by_rest - by_shared @ step]))
        for T, (by_rest, by_shared) in zip(fit.T_cam_box, own, strict=True)
    ]
    shape = fit.shape + step[CAMERA:].reshape(-1, SHAPE) if n > CAMERA else fit.shape
    return _Fit(focal_px=moved[0][0], lens=moved[0][1], T_cam_box=tuple(T for _, _, T in moved), shape=shape), cost


def _by_faces(target: Target, points: _Points, fit: _Fit, by_point: Array) -> Array:
    """Return how landmarks move in the image with the unknowns of all faces, (FACES * 9, 2, P) px.

    ``by_point`` (3, 2, P) is how they move with their place before the camera.
    """
    moves = by_shape(target, fit.shape)[points.rows, points.corner]
    for at, T in zip(points.of_view, fit.T_cam_box, strict=True):
        moves[at] = T[:3, :3] @ moves[at]
    on_face = np.einsum("iap,pik->kap", by_point, moves)
    face = target.tag_faces[points.rows]
    return np.concatenate([on_face * (face == f) for f in range(FACES)])
