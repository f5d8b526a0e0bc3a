"""How the box that was made may differ from the box that was designed: print scale, ink spread, poses of its faces."""

from dataclasses import dataclass

import numpy as np

from calib.errors import CalibError
from calib.estimate.options import EstimateOptions
from calib.frames import Array, exp_so3, hat, inverse, right_jacobian
from detect.wheels import Ids
from target.box import CORNERS, FACES

_OUTWARD = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""Where a tag's corners lie from its centre, x right and y up as seen from outside."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxShape:
    """The unknowns of the box, and the landmarks that they move.

    Attributes
    ----------
    names, sigma
        Of the unknowns, and of their priors.
    p_box : (L, 3), m
        Landmarks as designed.
    face : (L,)
        Face of each landmark.
    outward : (L, 2)
        Signs of the corner's direction from its tag's centre, in its face.
    T_box_face : (FACES, 4, 4), m
        Poses of the faces as designed.
    """

    names: tuple[str, ...]
    sigma: Array
    p_box: Array
    face: Ids
    outward: Array
    T_box_face: Array

    def landmarks(self, values: Array) -> tuple[Array, Array]:
        """Return the landmarks (L, 3), m, and their derivatives (L, 3, n) by the n unknowns.

        A landmark p of its face's plane becomes ``T_box_face exp(w, t) (scale * p + ink * outward)``.
        """
        d = np.zeros((len(self.p_box), 3, len(self.names)))
        if not self.names:
            return self.p_box, d
        at = {name: k for k, name in enumerate(self.names)}
        R, t = self.T_box_face[self.face, :3, :3], self.T_box_face[self.face, :3, 3]
        p = np.einsum("lji,lj->li", R, self.p_box - t)
        d_face = np.zeros_like(d)
        moved = p.copy()
        for axis, name in enumerate(("scale_x", "scale_y")):
            if name in at:
                moved[:, axis] += values[at[name]] * p[:, axis]
                d_face[:, axis, at[name]] = p[:, axis]
        if "ink" in at:
            moved[:, :2] += values[at["ink"]] * self.outward
            d_face[:, :2, at["ink"]] = self.outward
        for f in range(1, FACES):
            first = at.get(f"face{f}_rx")
            if first is None:
                continue
            rows = self.face == f
            w, shift = values[first : first + 3], values[first + 3 : first + 6]
            Rw = exp_so3(w)
            d_face[rows] = Rw @ d_face[rows]
            d_face[rows, :, first : first + 3] = -Rw @ hat(moved[rows]) @ right_jacobian(w)
            d_face[rows, :, first + 3 : first + 6] = np.eye(3)
            moved[rows] = moved[rows] @ Rw.T + shift
        return np.einsum("lij,lj->li", R, moved) + t, R @ d_face


def box_shape(options: EstimateOptions, landmark_ids: Ids, p_box: Array) -> BoxShape:
    """Return the unknowns of the box that the options ask for.

    Raises
    ------
    CalibError
        If a landmark is not of the box that the options describe.
    """
    names: list[str] = []
    sigma: list[float] = []
    if options.scale_sigma > 0:
        names += ["scale_x", "scale_y"]
        sigma += [options.scale_sigma] * 2
    if options.ink_sigma > 0:
        names.append("ink")
        sigma.append(options.ink_sigma)
    if options.face_sigma[1] > 0:
        for f in range(1, FACES):
            names += [f"face{f}_{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz")]
            sigma += [options.face_sigma[0]] * 3 + [options.face_sigma[1]] * 3
    face = np.zeros(len(landmark_ids), dtype=np.int64)
    poses = np.tile(np.eye(4), (FACES, 1, 1))
    if options.target is not None and names:
        target = options.target
        unknown = sorted({int(i) // CORNERS for i in np.unique(landmark_ids) if int(i) // CORNERS not in target})
        if unknown:
            raise CalibError(
                f"landmarks of tag {unknown[0]}, which the box' description does not carry; give the target.json that "
                "the landmarks were found with"
            )
        tags, back = np.unique(landmark_ids // CORNERS, return_inverse=True)
        face = target.tag_faces[[target.row_of(int(t)) for t in tags]][back]
        poses = np.array([target.box.T_box_face(f) for f in range(FACES)])
        off = np.abs(np.einsum("lij,lj->li", inverse(poses)[face, :3, :3], p_box - poses[face, :3, 3])[:, 2])
        if off.size and off.max() > 1e-6:
            raise CalibError(
                f"a landmark lies {off.max() * 1e3:.3g} mm off its face; give the target.json that the landmarks were "
                "found with"
            )
    return BoxShape(
        names=tuple(names),
        sigma=np.array(sigma),
        p_box=p_box,
        face=face,
        outward=_OUTWARD[landmark_ids % CORNERS],
        T_box_face=poses,
    )
