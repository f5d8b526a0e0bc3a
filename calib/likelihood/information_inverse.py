"""Inverse of information matrices, some directions of which the data may not determine."""

import numpy as np

from boxcal.target.arrays import Array

_NULL = 1e-13
"""Eigenvalues of the scaled information below this are zero: a direction that the data do not determine."""
_SMALL_PIVOT = 1e-5
"""Pivots of its Cholesky factor below this may hide such an eigenvalue: it is looked for."""


def invert(S: Array) -> tuple[Array, Array]:
    """Return the inverse of information matrices and their log determinants; null directions are left out."""
    scaled, scale = _unit_diagonal(S)
    try:
        factors = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return _pseudo_inverse(scaled, scale)
    pivots = np.einsum("...ii->...i", factors)
    if np.any(pivots < _SMALL_PIVOT):
        return _pseudo_inverse(scaled, scale)
    inverse = np.linalg.inv(scaled) * scale[..., :, None] * scale[..., None, :]
    log_det = 2 * np.sum(np.log(pivots) - np.log(scale), axis=-1)
    return (inverse + np.swapaxes(inverse, -1, -2)) / 2, log_det


def determinant(S: Array, right: Array) -> tuple[Array, Array]:
    """Return the log determinants of information matrices and ``right S^-1 right``, as :func:`invert` has them.

    A fraction of the work of the inverse: one more row of the Cholesky factor is ``L^-1 right``.
    """
    n = S.shape[-1]
    scaled, scale = _unit_diagonal(S)
    bordered = np.empty((*S.shape[:-2], n + 1, n + 1))
    bordered[..., :n, :n] = scaled
    bordered[..., n, :n] = bordered[..., :n, n] = right * scale
    bordered[..., n, n] = np.inf
    try:
        factors = np.linalg.cholesky(bordered)
    except np.linalg.LinAlgError:
        factors = np.zeros_like(bordered)
    pivots = np.einsum("...ii->...i", factors)[..., :n]
    if not np.all(pivots >= _SMALL_PIVOT):
        inverse, log_det = _pseudo_inverse(scaled, scale)
        return log_det, np.einsum("...i,...ij,...j->...", right, inverse, right)
    return 2 * np.sum(np.log(pivots) - np.log(scale), axis=-1), np.sum(factors[..., n, :n] ** 2, axis=-1)


def _unit_diagonal(S: Array) -> tuple[Array, Array]:
    """Return information matrices scaled to unit diagonal, and the scale (..., n)."""
    diagonal = np.einsum("...ii->...i", S)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return S * scale[..., :, None] * scale[..., None, :], scale


def _pseudo_inverse(scaled: Array, scale: Array) -> tuple[Array, Array]:
    """Return inverse and log determinant of matrices, given scaled to unit diagonal, that may be singular."""
    values, vectors = np.linalg.eigh(scaled)
    known = values > _NULL
    inverse = np.where(known, 1 / np.where(known, values, 1.0), 0.0)
    back = vectors * scale[..., :, None]
    log_det = np.sum(np.where(known, np.log(np.where(known, values, 1.0)), 0.0), axis=-1)
    return (back * inverse[..., None, :]) @ np.swapaxes(back, -1, -2), log_det - 2 * np.sum(np.log(scale), axis=-1)
