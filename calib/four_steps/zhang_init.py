"""A first guess of the camera matrix from planar views, so that no nominal focal length is asked for."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.detect.correspondences import StopObservation
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, FACES

MIN_POINTS = 8
"""Landmarks that a face needs in an image before its homography is used."""
_WHOLE = 3
"""Corners of a tag that determine its plane."""


def face_homographies(stops: Sequence[StopObservation]) -> list[Array]:
    """Return the homographies, (3, 3), from each well seen face of each stop (its own plane, m) to the image (px).

    By the direct linear transform, all faces at once. Tags of which fewer than three corners were seen are left aside:
    their face may not be known.
    """
    if not stops:
        return []
    ids, face = (np.concatenate([getattr(stop, name) for stop in stops]) for name in ("landmark_ids", "faces"))
    p, uv = (np.concatenate([getattr(stop, name) for stop in stops]) for name in ("p_box", "uv_px"))
    stop = np.repeat(np.arange(len(stops)), [len(stop.landmark_ids) for stop in stops])
    tag = ids // CORNERS  # ascending in each stop
    ends = np.flatnonzero(np.append((tag[1:] != tag[:-1]) | (stop[1:] != stop[:-1]), True)) + 1
    corners = np.diff(ends, prepend=0)
    rows = np.flatnonzero(np.repeat(corners >= _WHOLE, corners))
    rows = rows[np.argsort(FACES * stop[rows] + face[rows], kind="stable")]
    counts = np.bincount(FACES * stop[rows] + face[rows])
    counts = counts[counts > 0]
    rows, counts = rows[np.repeat(counts >= MIN_POINTS, counts)], counts[counts >= MIN_POINTS]
    if not len(counts):
        return []
    x, to_plane = _centred(p[rows], counts)
    axes = np.linalg.eigh(_summed(x[:, :, None] * x[:, None, :], counts))[1]
    plane = np.einsum("li,lij->lj", x, np.repeat(axes[:, :, :0:-1], counts, axis=0))
    image, to_image = _centred(uv[rows], counts)
    one = np.column_stack([plane, np.ones(len(plane))])
    J = np.zeros((len(one), 2, 9))
    J[:, 0, :3] = J[:, 1, 3:6] = one
    J[:, :, 6:] = -image[:, :, None] * one[:, None, :]
    parts = np.split(J.reshape(-1, 9), 2 * np.cumsum(counts)[:-1])
    H = np.linalg.eigh([part.T @ part for part in parts])[1][:, :, 0].reshape(-1, 3, 3)
    (centre, size), scale = to_image, 1 / to_plane[1]
    H = H * np.stack([scale, scale, np.ones_like(scale)], axis=1)[:, None, :]
    H[:, :2] = size[:, None, None] * H[:, :2] + centre[:, :, None] * H[:, 2:]
    return list(H)


def _summed(values: Array, counts: Ids) -> Array:
    return np.asarray(np.add.reduceat(values, np.cumsum(counts) - counts, axis=0))


def _centred(points: Array, counts: Ids) -> tuple[Array, tuple[Array, Array]]:
    """Return points of groups about their centre in units of their spread, and both of each group, (G, d) and (G,)."""
    centre = _summed(points, counts) / counts[:, None]
    off = points - np.repeat(centre, counts, axis=0)
    spread = np.sqrt(_summed(np.sum(off**2, axis=1), counts) / counts)
    spread[spread == 0] = 1.0  # coincident points carry no information
    return off / np.repeat(spread, counts)[:, None], (centre, spread)


def camera_matrix_guesses(homographies: list[Array], image_size: tuple[int, int]) -> list[Array]:
    """Return first guesses of K, (3, 3), px, without distortion.

    Each homography ``H = K [r1 r2 t]`` gives two equations linear in the image of the absolute conic
    (Zhang 2000, DOI 10.1109/34.888718). They are solved for (fu, fv, cu, cv), and for one focal length with the
    principal point in the image's centre, which also bears views that do not determine the rest. Guesses that are
    no camera (imaginary or absurd focal lengths) are left out; whoever calls keeps the guess that fits best.

    Raises
    ------
    CalibError
        If no guess is left: every face was seen straight on.
    """
    width, height = image_size
    scale = float(max(width, height))
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    N = np.array([[1 / scale, 0, -centre[0] / scale], [0, 1 / scale, -centre[1] / scale], [0, 0, 1]])
    h = (N @ np.array(homographies))[:, :, :2]
    h1, h2 = np.moveaxis(h / np.sqrt(np.sum(h**2, axis=(1, 2), keepdims=True)), (2, 1), (0, 1))  # (3, H) each
    A = np.stack([_conic_row(h1, h2), _conic_row(h1, h1) - _conic_row(h2, h2)], axis=1).reshape(-1, 5)
    found = []
    full = np.linalg.svd(A)[2][-1]
    found.append(_focal_and_centre(full if full[4] > 0 else -full))
    # One focal length, principal point in the centre: B = diag(w, w, 1), w = 1/f^2, by least squares.
    a, b = A[:, 0] + A[:, 1], A[:, 4]
    w = -(a @ b) / (a @ a) if a @ a > 0 else -1.0
    if w > 0:
        f = 1 / np.sqrt(w)
        found.append((float(f), float(f), 0.0, 0.0))
    guesses = [
        np.array([[fu * scale, 0, cu * scale + centre[0]], [0, fv * scale, cv * scale + centre[1]], [0, 0, 1]])
        for fu, fv, cu, cv in (g for g in found if g is not None)
        if 0.1 < fu < 30 and 0.1 < fv < 30 and 0.5 < fu / fv < 2 and abs(cu) < 0.5 and abs(cv) < 0.5
    ]
    if not guesses:
        raise CalibError(
            f"no focal length fits the {len(homographies)} views of faces: faces seen at a slant are needed",
            remedy="add stops that see two faces of the box at once",
        )
    return guesses


def _conic_row(a: Array, b: Array) -> Array:
    """Return the rows of ``a^T B b``, (H, 5), for a symmetric B without skew, unknowns (B11, B22, B13, B23, B33)."""
    parts = a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]
    return np.stack(parts, axis=-1)


def _focal_and_centre(B: Array) -> tuple[float, float, float, float] | None:
    b11, b22, b13, b23, b33 = B
    if b11 <= 0 or b22 <= 0:
        return None
    cu, cv = -b13 / b11, -b23 / b22
    lam = b33 - b13**2 / b11 - b23**2 / b22
    if lam <= 0:
        return None
    return float(np.sqrt(lam / b11)), float(np.sqrt(lam / b22)), float(cu), float(cv)
