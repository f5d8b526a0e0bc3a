"""Closed forms for many matrices of two by two, such as covariances of corners: LAPACK takes ten times as long."""

import numpy as np

from boxcal.target.arrays import Array


def determinants(M: Array) -> Array:
    """Return the determinants of matrices (..., 2, 2), (...)."""
    return np.asarray(M[..., 0, 0] * M[..., 1, 1] - M[..., 0, 1] * M[..., 1, 0])


def inverses(M: Array) -> Array:
    """Return the inverses of matrices (..., 2, 2)."""
    out = np.empty(M.shape)
    out[..., 0, 0], out[..., 1, 1] = M[..., 1, 1], M[..., 0, 0]
    out[..., 0, 1], out[..., 1, 0] = -M[..., 0, 1], -M[..., 1, 0]
    out /= determinants(M)[..., None, None]
    return out


def products(M: Array, v: Array) -> Array:
    """Return matrices (..., 2, 2) times vectors (..., 2)."""
    return np.stack(
        [M[..., 0, 0] * v[..., 0] + M[..., 0, 1] * v[..., 1], M[..., 1, 0] * v[..., 0] + M[..., 1, 1] * v[..., 1]],
        axis=-1,
    )


def inverse_roots(cov: Array) -> Array:
    """Return lower triangular W with ``W cov W^T = 1``, (..., 2, 2), for covariances (..., 2, 2).

    Raises
    ------
    LinAlgError
        If one of them is not positive definite.
    """
    a2, b = cov[..., 0, 0], cov[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        c2 = cov[..., 1, 1] - b * b / a2
    if not (np.all(a2 > 0) and np.all(c2 > 0)):
        raise np.linalg.LinAlgError("a covariance is not positive definite")
    out = np.zeros(cov.shape)
    out[..., 0, 0], out[..., 1, 1] = 1 / np.sqrt(a2), 1 / np.sqrt(c2)
    out[..., 1, 0] = -b / a2 * out[..., 1, 1]
    return out
