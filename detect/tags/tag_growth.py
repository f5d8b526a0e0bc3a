"""Outward displacement of the tags' edges, which a wrong response curve or dot gain moves equally.

Under a wrong response curve all tags look too small or too large by the same few tenths of a pixel while their pitch
stays, so the right curve is the one under which the tags of a face keep the size that their pitch says.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from boxcal.detect.tags.line_fit import edge_normals
from boxcal.target.arrays import Array, Index
from boxcal.target.box import Target

_MIN_TAGS = 4
"""Fewer tags of a face have hardly more corners than a homography and a growth have unknowns."""
_ROBUST_SIGMAS = 3.0
_LEAST_SIGMA_PX = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class TagGrowth:
    """Deviation of tags from their places on their faces.

    Attributes
    ----------
    growth_px : px
        How far all edges lie outwards; NaN if no face shows enough tags.
    sigma_px : px
        Robust deviation, per axis, of the corners from a homography of their face and that growth; NaN likewise.
    """

    growth_px: float
    sigma_px: float


def tag_growth(target: Target, rows: Index, corners_px: Array, centre_px: Array) -> TagGrowth:
    """Return how tags (rows (N,) of the target's table, corners (N, 4, 2) px) differ from their places.

    Corners of a face are fitted by a homography, two radial terms about ``centre_px`` (2,), and one more unknown, the
    growth: all edges moved outward by so much. It is solved for by least squares on what those leave (their Jacobian
    projected out), outliers left aside.
    """
    faces = target.tag_faces[rows]
    product = square = 0.0
    parts: list[tuple[Array, Array]] = []
    for face in np.unique(faces):
        on = faces == face
        if np.sum(on) < _MIN_TAGS:
            continue
        T_face_box = np.linalg.inv(target.T_box_face(int(face)))
        p_face = (target.tag_corners[rows[on]].reshape(-1, 3) @ T_face_box[:3, :3].T + T_face_box[:3, 3])[:, :2]
        outward, left = _beyond_homography(p_face / np.abs(p_face).max(), corners_px[on], centre_px)
        kept = np.abs(left) < _ROBUST_SIGMAS * 1.4826 * np.median(np.abs(left)) + _LEAST_SIGMA_PX
        product += float(np.sum((outward * left)[kept]))
        square += float(np.sum((outward**2)[kept]))
        parts.append((outward, left))
    if square <= 0:
        return TagGrowth(growth_px=float("nan"), sigma_px=float("nan"))
    growth = product / square
    apart = np.concatenate([left - growth * outward for outward, left in parts])
    return TagGrowth(growth_px=growth, sigma_px=1.4826 * float(np.median(np.abs(apart))))


def _beyond_homography(unit: Array, corners_px: Array, centre_px: Array) -> tuple[Array, Array]:
    """Return, (8 N,) each and freed of what a homography and a lens explain: corners' outward moves, and residuals."""
    normal = edge_normals(corners_px)
    before = np.roll(normal, 1, axis=1)
    outward = (normal + before) / (1 + np.sum(normal * before, axis=2, keepdims=True))
    uv_px = corners_px.reshape(-1, 2)
    H, _ = cv2.findHomography(unit, uv_px, 0)
    p = np.column_stack([unit, np.ones(len(unit))])
    mapped = p @ np.asarray(H).T
    fitted, p = mapped[:, :2] / mapped[:, 2:], p / mapped[:, 2:]
    zero = np.zeros_like(p)
    jacobian = np.concatenate(
        [np.column_stack([p, zero, -fitted[:, :1] * p]), np.column_stack([zero, p, -fitted[:, 1:] * p])]
    )
    d = (uv_px - centre_px) / np.abs(uv_px - centre_px).max()
    q = np.sum(d * d, axis=1)
    radial = np.stack([(d * (q**k)[:, None]).T.ravel() for k in (1, 2)], axis=1)
    jacobian = np.column_stack([jacobian, radial])
    both = np.stack([outward.reshape(-1, 2).T.ravel(), (uv_px - fitted).T.ravel()], axis=1)
    vectors, values, _ = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=0), full_matrices=False)
    basis = vectors[:, values > 1e-9 * values[0]]
    both -= basis @ (basis.T @ both)
    return both[:, 0], both[:, 1]
