"""A first guess of the camera matrix from planar views, so that no nominal focal length is asked for."""

import cv2
import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.detect.correspondences import StopObservation
from boxcal.target.arrays import Array, Ids

MIN_POINTS = 8
"""Landmarks that a face needs in an image before its homography is used."""
_SAME_PLANE = 0.97


def planar_groups(landmark_ids: Ids, p_box: Array) -> list[Ids]:
    """Return which landmarks lie on a common face: one array of row numbers for each face of the box.

    The faces are told apart by the tags' normals, so they need not be known by number.

    Parameters
    ----------
    landmark_ids : (L,)
        ``4 * tag id + corner``.
    p_box : (L, 3), m
    """
    tags, starts, counts = np.unique(landmark_ids // 4, return_index=True, return_counts=True)
    whole = np.flatnonzero(counts >= 3)
    first = starts[whole]
    p = p_box[first]
    normals = np.cross(p_box[first + 1] - p, p_box[first + 2] - p)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tag_of_row = np.repeat(np.arange(len(tags)), counts)
    out = []
    left = np.ones(len(whole), dtype=bool)
    while np.any(left):
        alike = left & (normals @ normals[int(np.argmax(left))] > _SAME_PLANE)
        out.append(np.flatnonzero(np.isin(tag_of_row, whole[alike])))
        left &= ~alike
    return out


def face_homographies(stop: StopObservation) -> list[Array]:
    """Return the homographies, (3, 3), from each well seen face (its own plane, m) to the image (px)."""
    out = []
    for rows in planar_groups(stop.landmark_ids, stop.p_box):
        if len(rows) < MIN_POINTS:
            continue
        p = stop.p_box[rows]
        _, _, axes = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)
        H, _ = cv2.findHomography((p - p.mean(axis=0)) @ axes[:2].T, stop.uv_px[rows])
        if H is not None and np.all(np.isfinite(H)):
            out.append(np.asarray(H, dtype=np.float64))
    return out


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
    rows = []
    for H in homographies:
        h1, h2 = (N @ H)[:, 0], (N @ H)[:, 1]
        size = np.sqrt(h1 @ h1 + h2 @ h2)
        h1, h2 = h1 / size, h2 / size
        rows += [_conic_row(h1, h2), _conic_row(h1, h1) - _conic_row(h2, h2)]
    A = np.array(rows).reshape(-1, 5)
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
    """Return the row of ``a^T B b`` for a symmetric B without skew, unknowns (B11, B22, B13, B23, B33)."""
    return np.array([a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]])


def _focal_and_centre(B: Array) -> tuple[float, float, float, float] | None:
    b11, b22, b13, b23, b33 = B
    if b11 <= 0 or b22 <= 0:
        return None
    cu, cv = -b13 / b11, -b23 / b22
    lam = b33 - b13**2 / b11 - b23**2 / b22
    if lam <= 0:
        return None
    return float(np.sqrt(lam / b11)), float(np.sqrt(lam / b22)), float(cu), float(cv)
