"""Inverse of information matrices, some directions of which the data may not determine."""

import numpy as np

from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.small_matrices import unit_diagonal
from boxcal.target.arrays import Array

_NULL = 1e-13
"""Eigenvalues of the scaled information below this are zero: a direction that the data do not determine."""
_SMALL_PIVOT = 1e-10
"""Pivots of its elimination below this may hide such an eigenvalue: it is looked for."""


def invert(S: Array) -> tuple[Array, Array]:
    """Return the inverse of information matrices and their log determinants; null directions are left out."""
    inverse, log_det, smallest = backend().scaled_inverses(S)
    return (inverse, log_det) if smallest >= _SMALL_PIVOT else _pseudo_inverse(S)


def determinant(S: Array, right: Array) -> tuple[Array, Array]:
    """Return the log determinants of information matrices and ``right S^-1 right``, as :func:`invert` has them."""
    log_det, decrease, smallest = backend().scaled_determinants(S, right)
    if smallest >= _SMALL_PIVOT:
        return log_det, decrease
    inverse, log_det = _pseudo_inverse(S)
    return log_det, np.einsum("...i,...ij,...j->...", right, inverse, right)


def _pseudo_inverse(S: Array) -> tuple[Array, Array]:
    """Return inverse and log determinant of matrices that may be singular."""
    scaled, scale = unit_diagonal(S)
    values, vectors = np.linalg.eigh(scaled)
    known = values > _NULL
    inverse = np.where(known, 1 / np.where(known, values, 1.0), 0.0)
    back = vectors * scale[..., :, None]
    log_det = np.sum(np.where(known, np.log(np.where(known, values, 1.0)), 0.0), axis=-1)
    return (back * inverse[..., None, :]) @ np.swapaxes(back, -1, -2), log_det - 2 * np.sum(np.log(scale), axis=-1)
