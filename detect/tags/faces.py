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
    planes: dict[int, tuple[Array, float]] = {}
    whole = counts >= 3
    for k in np.flatnonzero(whole):
        a, b, c = p_box[starts[k] : starts[k] + 3]  # three corners in their order turn clockwise, seen from outside
        normal = np.cross(c - b, b - a)
        normal /= np.linalg.norm(normal)
        faces[k] = round(float(np.arctan2(normal[1], normal[0])) / (np.pi / 2)) % FACES
        planes[int(faces[k])] = (normal, float(normal @ a))
    for k in np.flatnonzero(~whole):
        off = {f: abs(float(normal @ p_box[starts[k]]) - d) for f, (normal, d) in planes.items()}
        faces[k] = min(off, key=lambda f: off[f], default=0)
    return np.repeat(faces, counts)
