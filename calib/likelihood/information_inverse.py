"""Inverse of information matrices, some directions of which the data may not determine."""

import numpy as np

from boxcal.target.arrays import Array

_NULL = 1e-13
"""Eigenvalues of the scaled information below this are zero: a direction that the data do not determine."""
_SMALL_PIVOT = 1e-5
"""Pivots of its Cholesky factor below this may hide such an eigenvalue: it is looked for."""


def invert(S: Array) -> tuple[Array, Array]:
    """Return the inverse of information matrices and their log determinants; null directions are left out."""
    diagonal = np.einsum("...ii->...i", S)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = S * scale[..., :, None] * scale[..., None, :]
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


def _pseudo_inverse(scaled: Array, scale: Array) -> tuple[Array, Array]:
    """Return inverse and log determinant of matrices, given scaled to unit diagonal, that may be singular."""
    values, vectors = np.linalg.eigh(scaled)
    known = values > _NULL
    inverse = np.where(known, 1 / np.where(known, values, 1.0), 0.0)
    back = vectors * scale[..., :, None]
    log_det = np.sum(np.where(known, np.log(np.where(known, values, 1.0)), 0.0), axis=-1)
    return (back * inverse[..., None, :]) @ np.swapaxes(back, -1, -2), log_det - 2 * np.sum(np.log(scale), axis=-1)
