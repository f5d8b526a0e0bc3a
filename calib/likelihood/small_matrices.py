"""Inverses and determinants of many small matrices, in numpy: the reference that the compiled loops are held to."""

import numpy as np

from boxcal.target.arrays import Array


def inverses(A: Array) -> tuple[Array, Array]:
    """Return the inverses of positive definite matrices, (..., k, k), and the logarithms of their determinants, (...).

    Raises
    ------
    LinAlgError
        If one is singular.
    """
    return np.asarray(np.linalg.inv(A), dtype=np.float64), np.asarray(np.linalg.slogdet(A)[1])


def scaled_inverses(S: Array) -> tuple[Array, Array, float]:
    """Return inverses (..., n, n) and log determinants (...) of information matrices, and their smallest pivot.

    The pivot is that of Gauss's elimination once all diagonals are 1; where it is not positive the rest is no answer.
    """
    scaled, scale = unit_diagonal(S)
    try:
        factors = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return np.zeros_like(S), np.zeros(S.shape[:-2]), 0.0
    pivots = np.einsum("...ii->...i", factors)
    inverse = np.linalg.inv(scaled) * scale[..., :, None] * scale[..., None, :]
    log_det = 2 * np.sum(np.log(pivots) - np.log(scale), axis=-1)
    return (inverse + np.swapaxes(inverse, -1, -2)) / 2, log_det, float(np.min(pivots, initial=1.0)) ** 2


def scaled_determinants(S: Array, right: Array) -> tuple[Array, Array, float]:
    """Return log determinants (...) of information matrices, ``right S^-1 right`` (...), and their smallest pivot.

    A fraction of the work of the inverse: one more row of the Cholesky factor is ``L^-1 right``. The pivot as of
    :func:`scaled_inverses`.
    """
    n = S.shape[-1]
    scaled, scale = unit_diagonal(S)
    bordered = np.empty((*S.shape[:-2], n + 1, n + 1))
    bordered[..., :n, :n] = scaled
    bordered[..., n, :n] = bordered[..., :n, n] = right * scale
    bordered[..., n, n] = np.inf
    try:
        factors = np.linalg.cholesky(bordered)
    except np.linalg.LinAlgError:
        return np.zeros(S.shape[:-2]), np.zeros(S.shape[:-2]), 0.0
    pivots = np.einsum("...ii->...i", factors)[..., :n]
    log_det = 2 * np.sum(np.log(pivots) - np.log(scale), axis=-1)
    return log_det, np.sum(factors[..., n, :n] ** 2, axis=-1), float(np.min(pivots, initial=1.0)) ** 2


def unit_diagonal(S: Array) -> tuple[Array, Array]:
    """Return information matrices scaled to unit diagonal, and the scale (..., n)."""
    diagonal = np.einsum("...ii->...i", S)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return S * scale[..., :, None] * scale[..., None, :], scale
