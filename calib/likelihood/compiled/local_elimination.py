"""Local unknowns eliminated, compiled: see :mod:`boxcal.calib.likelihood.local_elimination`."""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.calib.likelihood.compiled.small_matrices import sweep


def without_local(chain: Any, local: Any, weight: float, sigma: Any, unit: Any) -> tuple[Any, Any, float, float]:
    """Return what :func:`boxcal.calib.likelihood.local_elimination.without_local` does."""
    P, q = sigma.shape
    n, k = chain[1].shape[1:]
    reduced = np.empty((n, n)), np.empty((P, k, n + 1)), np.empty((P, k, k)), np.empty(n)
    found = np.empty((P, q, q)), np.zeros((P, q, n)), np.zeros((P, q, k)), np.zeros((P, q))
    of_corners = tuple(np.ascontiguousarray(part) for part in (*chain, *local, unit))
    own = np.array(sigma, order="C")  # one that may be written, as others are: code is made for the type
    decrease, log_det = eliminate_local(of_corners, own, weight, reduced, found)
    if np.isnan(log_det):
        raise np.linalg.LinAlgError("Singular matrix")
    return reduced, found, decrease, log_det


@kernel()
def eliminate_local(  # noqa: PLR0912
    of_corners: Any, sigma: Any, weight: float, reduced: Any, found: Any
) -> tuple[float, float]:
    """Fill the reduced equations and what finds the local unknowns again; return decrease and log determinant."""
    A0, B0, D0, a0, c0, local_D, local_B, local_E, local_c, unit = of_corners
    A, right, D, a = reduced
    inverse, by_shared, by_chain, alone = found
    (P, q), (n, k) = sigma.shape, B0.shape[1:]
    decrease, total = 0.0, 0.0
    scaled, pull = np.empty((q, n)), np.empty(q)
    for m in range(n):
        a[m] = weight * a0[m]
        for r in range(n):
            A[m, r] = weight * A0[m, r]
    for p in range(P):
        for i in range(q):
            w = weight * sigma[p, i]
            pull[i] = w * local_c[p, i] - unit[p, i]
            for m in range(n):
                scaled[i, m] = w * local_B[p, m, i]
            for j in range(q):
                inverse[p, i, j] = w * sigma[p, j] * local_D[p, i, j] + (1.0 if i == j else 0.0)
        log_det, _ = sweep(inverse[p])
        if np.isnan(log_det):
            return 0.0, np.nan
        total += log_det
        for i in range(q):
            for j in range(q):
                f = inverse[p, i, j]
                alone[p, i] += f * pull[j]
                for m in range(n):
                    by_shared[p, i, m] += f * scaled[j, m]
                for m in range(k):
                    by_chain[p, i, m] += f * weight * sigma[p, j] * local_E[p, m, j]
            decrease += pull[i] * alone[p, i]
        for u in range(k):
            for m in range(n):
                right[p, u, m] = weight * B0[p, m, u]
            right[p, u, n] = weight * c0[p, u]
            for v in range(k):
                D[p, u, v] = weight * D0[p, u, v]
            for i in range(q):
                f = weight * sigma[p, i] * local_E[p, u, i]
                for m in range(n):
                    right[p, u, m] -= f * by_shared[p, i, m]
                right[p, u, n] -= f * alone[p, i]
                for v in range(k):
                    D[p, u, v] -= f * by_chain[p, i, v]
        for i in range(q):
            for m in range(n):
                f = scaled[i, m]
                a[m] -= f * alone[p, i]
                for r in range(n):
                    A[m, r] -= f * by_shared[p, i, r]
    return decrease, total
