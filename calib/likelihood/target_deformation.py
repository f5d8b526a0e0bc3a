"""How the box that was made may differ from the box that is described: its sizes, ink spread, poses of its faces."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import exp_so3, hat, right_jacobian
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, FACES
from boxcal.target.measure.size_influence import size_jacobian

_OUTWARD = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""Where a tag's corners lie from its centre, x right and y up as seen from outside."""
SIZE_NAMES = ("scale_x", "scale_y", "width", "depth")
"""The sizes that corners depend on, in the order of :data:`target.measured.SIZES`."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxShape:
    """The unknowns of the box, all zero for the box as described, and the landmarks that they move.

    Attributes
    ----------
    names : n
        ``scale_x, scale_y`` (relative), ``width, depth`` (m): how much larger the prints and the box are than
        described; ``ink`` (m); ``face1_rx`` ... ``face3_tz`` (rad, m).
    prior : (n, n)
        Covariance of their prior.
    p_box : (L, 3), m
        Landmarks as described.
    by_size : (L, 3, 4)
        Their derivatives by the sizes (see :func:`boxcal.target.measure.size_influence.size_jacobian`).
    face : (L,)
        Face of each landmark.
    outward : (L, 2)
        Signs of the corner's direction from its tag's centre, in its face.
    T_box_face : (FACES, 4, 4), m
        Poses of the faces as described.
    """

    names: tuple[str, ...]
    prior: Array
    p_box: Array
    by_size: Array
    face: Ids
    outward: Array
    T_box_face: Array

    def landmarks(self, values: Array) -> tuple[Array, Array]:
        """Return the landmarks (L, 3), m, and their derivatives (L, 3, n) by the n unknowns.

        A landmark p of its face's frame becomes ``T_box_face exp(w, t) (p + sizes + ink * outward)``.
        """
        d = np.zeros((len(self.p_box), 3, len(self.names)))
        if not self.names:
            return self.p_box, d
        at = {name: k for k, name in enumerate(self.names)}
        R, t = self.T_box_face[self.face, :3, :3], self.T_box_face[self.face, :3, 3]
        R_t = np.swapaxes(R, 1, 2)
        p = np.einsum("lij,lj->li", R_t, self.p_box - t)
        for k, name in enumerate(SIZE_NAMES):
            if name in at:
                d[:, :, at[name]] = np.einsum("lij,lj->li", R_t, self.by_size[:, :, k])
                p = p + values[at[name]] * d[:, :, at[name]]
        if "ink" in at:
            p[:, :2] += values[at["ink"]] * self.outward
            d[:, :2, at["ink"]] = self.outward
        for f in range(1, FACES):
            first = at.get(f"face{f}_rx")
            if first is None:
                continue
            rows = self.face == f
            w, shift = values[first : first + 3], values[first + 3 : first + 6]
            Rw = exp_so3(w)
            d[rows] = Rw @ d[rows]
            d[rows, :, first : first + 3] = -Rw @ hat(p[rows]) @ right_jacobian(w)
            d[rows, :, first + 3 : first + 6] = np.eye(3)
            p[rows] = p[rows] @ Rw.T + shift
        return np.einsum("lij,lj->li", R, p) + t, R @ d


def box_shape(options: EstimateOptions, landmark_ids: Ids, p_box: Array) -> BoxShape:
    """Return the unknowns of the box that the options ask for.

    Raises
    ------
    CalibError
        If a landmark is not of the box that the options describe.
    """
    names, prior = _unknowns(options)
    face = np.zeros(len(landmark_ids), dtype=np.int64)
    poses, by_size = np.tile(np.eye(4), (FACES, 1, 1)), np.zeros((len(landmark_ids), 3, len(SIZE_NAMES)))
    if options.target is not None and names:
        target = options.target
        unknown = sorted({int(i) // CORNERS for i in np.unique(landmark_ids) if int(i) // CORNERS not in target})
        if unknown:
            raise CalibError(
                f"landmarks of tag {unknown[0]}, which the box' description does not carry; give the target.json that "
                "the landmarks were found with"
            )
        tags, back = np.unique(landmark_ids // CORNERS, return_inverse=True)
        rows = np.array([target.row_of(int(t)) for t in tags])[back]
        face, by_size = target.tag_faces[rows], size_jacobian(target)[rows, landmark_ids % CORNERS, :, :4]
        poses = np.array([target.T_box_face(f) for f in range(FACES)])
        off = np.linalg.norm(target.tag_corners[rows, landmark_ids % CORNERS] - p_box, axis=1)
        if off.size and off.max() > 1e-6:
            raise CalibError(
                f"a landmark lies {off.max() * 1e3:.3g} mm from where the box' description has it; give the "
                "target.json that the landmarks were found with"
            )
    return BoxShape(
        names=names,
        prior=prior,
        p_box=p_box,
        by_size=by_size,
        face=face,
        outward=_OUTWARD[landmark_ids % CORNERS],
        T_box_face=poses,
    )


def _unknowns(options: EstimateOptions) -> tuple[tuple[str, ...], Array]:
    """Return the names of the box' unknowns and the covariance of their prior."""
    names: list[str] = []
    sizes = np.zeros((4, 4))
    measured = options.target.measured if options.target is not None and options.measured_sizes else None
    if measured is not None:
        sizes += measured.cov[:4, :4]
    sizes += np.diag([options.scale_sigma**2] * 2 + [options.size_sigma**2] * 2)
    known = np.flatnonzero(np.diag(sizes) > 0)
    names += [SIZE_NAMES[k] for k in known]
    other: list[float] = []
    if options.ink_sigma > 0:
        names.append("ink")
        other.append(options.ink_sigma)
    if options.face_sigma[1] > 0:
        for f in range(1, FACES):
            names += [f"face{f}_{axis}" for axis in ("rx", "ry", "rz", "tx", "ty", "tz")]
            other += [options.face_sigma[0]] * 3 + [options.face_sigma[1]] * 3
    prior = np.zeros((len(names), len(names)))
    prior[: len(known), : len(known)] = sizes[np.ix_(known, known)]
    rest = np.arange(len(known), len(names))
    prior[rest, rest] = np.square(other)
    return tuple(names), prior
