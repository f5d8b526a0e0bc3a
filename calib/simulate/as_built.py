"""The box as it was built: where its landmarks really are."""

from dataclasses import replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_se3
from boxcal.calib.simulate.imperfections import BoxFaults
from boxcal.target.box import CORNERS, FACES, Target, make_target


def as_built(target: Target, box: BoxFaults) -> Target:
    """Return the target with its landmarks where they really are."""
    design = box.other or target.box
    count, n = design.tags_a_face, FACES * design.tags_a_face
    corners, faces = np.zeros((n, CORNERS, 3)), np.zeros(n, dtype=np.int64)
    place = np.zeros((FACES, 3)) if box.place is None else box.place
    pose = np.zeros((FACES, 6)) if box.pose is None else box.pose
    for f, sheet in enumerate(box.order):
        rows = slice(sheet * count, (sheet + 1) * count)
        sheet_at = design.T_box_face(sheet)
        printed = make_target(design).tag_corners[rows] if box.other else target.tag_corners[rows]
        p_face = (printed - sheet_at[:3, 3]) @ sheet_at[:3, :3]
        g = p_face[..., :2] * box.scale * box.face_scale[f]
        g = -g if sheet in box.turned else g
        c, s = np.cos(place[f, 2]), np.sin(place[f, 2])
        g = g @ np.array([[c, s], [-s, c]]) + place[f, :2]
        out = p_face[..., 2] + box.bow[f] * (1 - (2 * g[..., 0] / design.face_width(f)) ** 2)
        p = np.concatenate([g, out[..., None]], axis=2)
        T = design.T_box_face(f) @ exp_se3(pose[f])
        corners[rows], faces[rows] = p @ T[:3, :3].T + T[:3, 3], f
    return replace(target, tag_corners=corners, tag_faces=faces)


def flat_as_built(target: Target, box: BoxFaults) -> Target:
    """Return the target as built but for its faces' bow, under the outline of the box that stands there."""
    return replace(as_built(target, replace(box, bow=(0.0,) * FACES)), box=box.other or target.box)
