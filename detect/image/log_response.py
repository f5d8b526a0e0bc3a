"""Which response curve a camera has, told from the tags themselves.

Under the wrong curve all tags look too small or too large, by the same few tenths of a pixel, while their pitch stays:
so the right curve is the one under which the tags of a face keep the size that their pitch says.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.tags.detections import TagDetections, TagSettings, find_tags
from boxcal.detect.tags.line_fit import RESPONSES, edge_normals
from boxcal.target.arrays import Array
from boxcal.target.box import Target

_MIN_TAGS = 6
_ROBUST_SIGMAS = 3.0
_LEAST_SIGMA_PX = 0.02


def choose_response(images: Sequence[NDArray[np.uint8]], target: Target, settings: TagSettings) -> str:
    """Return the response curve (one of ``corners.RESPONSES``) under which tags grow or shrink least in some images.

    The settings' own curve is kept where no face shows enough tags to tell.
    """
    growths = {}
    for response in RESPONSES:
        under = replace(settings, corners=replace(settings.corners, response=response))
        found = [tag_growth_px(find_tags(image, target, under), target) for image in images]
        growths[response] = [g for g in found if g is not None]
    if not all(growths.values()):
        return settings.corners.response
    return min(RESPONSES, key=lambda response: abs(float(np.median(growths[response]))))


def tag_growth_px(tags: TagDetections, target: Target) -> float | None:
    """Return how far the tags' edges lie outside their places, px; None if no face shows enough tags.

    Corners of a face are fitted by a homography and one more unknown, the growth: all edges moved outward by so much.
    It is solved for by least squares on what the homography leaves (its Jacobian projected out), a few outliers left
    aside.
    """
    rows = np.array([target.row_of(int(i)) for i in tags.ids], dtype=np.int64)
    faces = target.tag_faces[rows] if rows.size else rows
    product = square = 0.0
    for face in np.unique(faces):
        on = faces == face
        if np.sum(on) < _MIN_TAGS:
            continue
        T_face_box = np.linalg.inv(target.T_box_face(int(face)))
        p_face = (target.tag_corners[rows[on]].reshape(-1, 3) @ T_face_box[:3, :3].T + T_face_box[:3, 3])[:, :2]
        unit = p_face / np.abs(p_face).max()
        outward, left = _beyond_homography(unit, tags.corners_px[on])
        kept = np.abs(left) < _ROBUST_SIGMAS * 1.4826 * np.median(np.abs(left)) + _LEAST_SIGMA_PX
        product += float(np.sum((outward * left)[kept]))
        square += float(np.sum((outward**2)[kept]))
    return product / square if square > 0 else None


def _beyond_homography(unit: Array, corners_px: Array) -> tuple[Array, Array]:
    """Return, (8 N,) each and freed of what a homography can explain: corners' outward moves and corners' residuals."""
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
    both = np.stack([outward.reshape(-1, 2).T.ravel(), (uv_px - fitted).T.ravel()], axis=1)
    basis = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=0), full_matrices=False)[0][:, :8]
    both -= basis @ (basis.T @ both)
    return both[:, 0], both[:, 1]
