"""Derivatives of a target's corners by the sizes that a ruler measures."""

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.measure.measured_size import SIZES


def size_jacobian(target: Target) -> Array:
    """Return the derivative of ``tag_corners`` by (sx, sy, width, depth, height), (T, 4, 3, 5).

    Metres by scale in the first two columns, metres by metre in the others. The corners are linear in these dimensions,
    so it holds for a measured target and for one as designed alike. The last column is zero: sheets stand on the
    base (see :class:`~boxcal.target.measure.measured_size.Measured`).
    """
    box = target.box
    grid = box.grid_corners()
    J = np.zeros((*target.tag_corners.shape, len(SIZES)))
    for face in range(FACES):
        rows = target.tag_faces == face
        x, y, n = target.T_box_face(face)[:3, :3].T
        J[rows, ..., 0] = grid[..., :1] * x
        J[rows, ..., 1] = (grid[..., 1:] + box.height / 2) * y
        J[rows, ..., 2 if face % 2 == 0 else 3] = n / 2
    return J


def scale_influence(target: Target) -> Array:
    """Return by how much, relative, the target as a whole grows with each of its sizes, (5,).

    It is the scale of the similarity that fits the landmarks' displacements best (least squares; rotation and
    translation are free), so it says what a calibration that sees all faces takes for its metre. Times a size's
    sigma it is that size's part in the relative error of rL, rR, b and t.
    """
    p = target.tag_corners.reshape(-1, 3) - target.tag_corners.reshape(-1, 3).mean(axis=0)
    J = size_jacobian(target).reshape(-1, 3, len(SIZES))
    return np.asarray(np.einsum("ni,nik->k", p, J) / np.sum(p * p))


def measured_scale_sigma(target: Target) -> float:
    """Return what the ruler's uncertainty adds to every length, relative; 0 for a target as designed."""
    if target.measured is None:
        return 0.0
    influence = scale_influence(target)
    return float(np.sqrt(influence @ target.measured.cov @ influence))
