"""Transform between two cameras of one robot, and its covariance by that of their extrinsics."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import hat, inverse
from boxcal.target.arrays import Array


def between(T_body_a: Array, T_body_b: Array) -> Array:
    """Return ``T_a_b`` (4, 4), m, which maps points of camera b to camera a."""
    return np.asarray(inverse(T_body_a) @ T_body_b)


def pair_jacobian(T_body_a: Array, T_body_b: Array) -> Array:
    """Return the derivative (6, 12) of ``T_a_b`` by the extrinsics of a, then b.

    Rotations are right perturbations: of the extrinsics about the cameras' own axes, of the pair about b's.
    Translations are along the body's axes for the extrinsics, along a's for the pair.
    """
    R_a, T = T_body_a[:3, :3], between(T_body_a, T_body_b)
    J = np.zeros((6, 12))
    J[:3, :3], J[:3, 6:9] = -T[:3, :3].T, np.eye(3)
    J[3:, :3] = hat(T[:3, 3])
    J[3:, 3:6], J[3:, 9:12] = -R_a.T, R_a.T
    return J
