"""Inverses and determinants of many small matrices, compiled: see :mod:`boxcal.calib.likelihood.small_matrices`."""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel


@kernel(inner=True)
def sweep(A: Any) -> tuple[float, float]:
    """Replace A (k, k) by its inverse; return the logarithm of its determinant, and its smallest pivot.

    Gauss-Jordan elimination; A is positive definite, so no pivot is sought. NaN and 0 where one is no number, or 0.
    """
    k, log_det, smallest = A.shape[0], 0.0, np.inf
    for i in range(k):
        pivot = A[i, i]
        if pivot == 0.0 or not np.isfinite(pivot):
            return np.nan, 0.0
        log_det += np.log(abs(pivot))
        smallest = min(smallest, pivot)
        A[i, i] = 1.0
        for m in range(k):
            A[i, m] /= pivot
        for r in range(k):
            if r != i:
                f = A[r, i]
                A[r, i] = 0.0
                for m in range(k):
                    A[r, m] -= f * A[i, m]
    return log_det, smallest


@kernel()
def sweep_all(A: Any, log_det: Any) -> bool:
    """Replace matrices A (M, k, k) by their inverses and fill their log determinants (M,); False if one has none."""
    for n in range(len(A)):
        log_det[n], _ = sweep(A[n])
        if np.isnan(log_det[n]):
            return False
    return True


@kernel(inner=True)
def scale_to_unit(S: Any, scale: Any) -> float:
    """Scale S (n, n) to unit diagonal, fill the scale (n,) and return the logarithm of S's determinant over the new."""
    n, log_det = len(scale), 0.0
    for i in range(n):
        scale[i] = 1 / np.sqrt(S[i, i]) if S[i, i] > 0 else 1.0
        log_det -= 2 * np.log(scale[i])
    for i in range(n):
        for j in range(n):
            S[i, j] *= scale[i] * scale[j]
    return log_det


@kernel()
def sweep_scaled(S: Any, log_det: Any) -> float:
    """Replace information matrices S (M, n, n) by their inverses; return the smallest pivot of all."""
    n, smallest = S.shape[1], 1.0
    scale = np.empty(n)
    for q in range(len(S)):
        of_scale = scale_to_unit(S[q], scale)
        of_scaled, pivot = sweep(S[q])
        if not pivot > 0:
            return 0.0
        smallest, log_det[q] = min(smallest, pivot), of_scale + of_scaled
        for i in range(n):
            for j in range(i + 1):
                value = (S[q, i, j] + S[q, j, i]) / 2 * scale[i] * scale[j]
                S[q, i, j] = value
                S[q, j, i] = value
    return smallest


@kernel()
def factor_scaled(S: Any, right: Any, log_det: Any, decrease: Any) -> float:
    """Fill log determinants and ``right S^-1 right``, (M,) each; S (M, n, n) is used up."""
    n, smallest = S.shape[1], 1.0
    scale, y = np.empty(n), np.empty(n)
    for q in range(len(S)):
        U = S[q]  # Cholesky factor, row by row of the upper half
        log_det[q], decrease[q] = scale_to_unit(U, scale), 0.0
        for i in range(n):
            y[i] = right[q, i] * scale[i]
        for i in range(n):
            pivot = U[i, i]
            if not pivot > 0:
                return 0.0
            smallest = min(smallest, pivot)
            log_det[q] += np.log(pivot)
            f = 1 / np.sqrt(pivot)
            for m in range(i, n):
                U[i, m] *= f
            value = f * y[i]
            decrease[q] += value * value
            for r in range(i + 1, n):
                f = U[i, r]
                y[r] -= f * value
                for m in range(r, n):
                    U[r, m] -= f * U[i, m]
    return smallest


def inverses(A: Any) -> tuple[Any, Any]:
    """Return inverses and log determinants: see :func:`boxcal.calib.likelihood.small_matrices.inverses`."""
    out, log_det = np.array(A, dtype=np.float64, order="C"), np.empty(A.shape[:-2])
    if not sweep_all(out.reshape(-1, *A.shape[-2:]), log_det.reshape(-1)):
        raise np.linalg.LinAlgError("Singular matrix")
    return out, log_det


def scaled_inverses(S: Any) -> tuple[Any, Any, float]:
    """Return inverses and more: see :func:`boxcal.calib.likelihood.small_matrices.scaled_inverses`."""
    out, log_det = np.array(S, dtype=np.float64, order="C"), np.empty(S.shape[:-2])
    smallest = sweep_scaled(out.reshape(-1, *S.shape[-2:]), log_det.reshape(-1))
    return out, log_det, smallest


def scaled_determinants(S: Any, right: Any) -> tuple[Any, Any, float]:
    """Return determinants and more: see :func:`boxcal.calib.likelihood.small_matrices.scaled_determinants`."""
    n, batch = S.shape[-1], S.shape[:-2]
    log_det, decrease = np.empty(batch), np.empty(batch)
    work = np.array(S, dtype=np.float64, order="C").reshape(-1, n, n)
    along = np.ascontiguousarray(right, dtype=np.float64).reshape(-1, n)
    smallest = factor_scaled(work, along, log_det.reshape(-1), decrease.reshape(-1))
    return log_det, decrease, smallest
