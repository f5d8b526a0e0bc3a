"""Shape of a box as it was built: for each face its print's size along both axes, where the print lies, and its bow."""

from dataclasses import replace

import cv2
import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target

SHAPE = 9
"""Unknowns of a face: its print's size across and up, less one, place (right, up, out), turn, and bow."""


def shaped(target: Target, shape: Array) -> Target:
    """Return a box whose prints are of another size and lie elsewhere, by the unknowns (FACES, 9) of its faces."""
    corners = target.tag_corners.copy()
    for face in range(FACES):
        on, T = target.tag_faces == face, target.T_box_face(face)
        p_face = _on_paper(target, face, shape[face])
        corners[on] = (p_face @ cv2.Rodrigues(shape[face, 5:8])[0].T + shape[face, 2:5]) @ T[:3, :3].T + T[:3, 3]
    return replace(target, tag_corners=corners)


def _on_paper(target: Target, face: int, shape: Array) -> Array:
    """Return the landmarks (N, 4, 3) of a face in its frame, of a print of another size that is bowed."""
    T = target.T_box_face(face)
    p_face = (target.tag_corners[target.tag_faces == face] - T[:3, 3]) @ T[:3, :3]
    bowed = p_face[..., 2] + shape[8] * _sagitta(target, face, p_face)
    return np.concatenate([p_face[..., :2] * (1 + shape[:2]), bowed[..., None]], axis=-1)


def _sagitta(target: Target, face: int, p_face: Array) -> Array:
    """Return the fraction of a face's bow at landmarks (..., 3) in its frame, 1 in its middle and 0 at its edges."""
    return np.asarray(1 - (2 * p_face[..., 0] / target.box.face_width(face)) ** 2)


def by_shape(target: Target, shape: Array) -> Array:
    """Return how landmarks (T, 4, 3) of :func:`shaped` move with the unknowns of their face, (T, 4, 3, 9).

    Turns are those about the face's axes that are added to the others, exact where these are small.
    """
    out = np.zeros((*target.tag_corners.shape, SHAPE))
    for face in range(FACES):
        on, T = target.tag_faces == face, target.T_box_face(face)
        p, turned = (target.tag_corners[on] - T[:3, 3]) @ T[:3, :3], cv2.Rodrigues(shape[face, 5:8])[0]
        own = np.zeros((*p.shape, SHAPE))
        own[..., :2] = p[..., None, :2] * turned[:, :2]
        own[..., 2:5] = np.eye(3)
        built = _on_paper(target, face, shape[face]) @ turned.T
        own[..., 5:8] = np.stack([np.cross(axis, built) for axis in np.eye(3)], axis=-1)
        own[..., 8] = _sagitta(target, face, p)[..., None] * turned[:, 2]
        out[on] = T[:3, :3] @ own
    return out
