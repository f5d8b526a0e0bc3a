"""Faces of the box that carry landmarks, found from where these are."""

import numpy as np

from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, FACES


def faces_by_normal(landmark_ids: Ids, p_box: Array) -> Ids:
    """Return the faces that carry landmarks, (L,), found from the outward normals of the tags.

    A tag of which fewer than three corners were seen has no normal; it is on the face whose tags' plane is nearest.

    Parameters
    ----------
    landmark_ids : (L,)
        ``4 * tag id + corner``, ascending.
    p_box : (L, 3), m
    """
    tags, starts, counts = np.unique(landmark_ids // CORNERS, return_index=True, return_counts=True)
    faces = np.zeros(len(tags), dtype=np.int64)
    whole = counts >= 3
    a, b, c = np.moveaxis(p_box[starts[whole, None] + np.arange(3)], 1, 0)  # clockwise, seen from outside
    normals = np.cross(c - b, b - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces[whole] = np.rint(np.arctan2(normals[:, 1], normals[:, 0]) / (np.pi / 2)).astype(np.int64) % FACES
    planes = dict(zip(faces[whole].tolist(), zip(normals, np.sum(normals * a, axis=1), strict=True), strict=True))
    for k in np.flatnonzero(~whole):
        off = {f: abs(float(normal @ p_box[starts[k]]) - d) for f, (normal, d) in planes.items()}
        faces[k] = min(off, key=lambda f: off[f], default=0)
    return np.repeat(faces, counts)
