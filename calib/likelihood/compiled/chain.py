"""The chain of stops, compiled: see :mod:`boxcal.calib.likelihood.chain`.

Loops are written out over single numbers: that compiles in a fraction of the time that parts of arrays take.
"""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.calib.likelihood.compiled.small_matrices import sweep


@kernel()
def _eliminate(  # noqa: PLR0912, PLR0917
    D: Any, E: Any, right: Any, pivots: Any, gains: Any, back: Any, log_det: Any
) -> bool:
    K, P, k, columns = right.shape
    work = np.empty((k, k))
    for q in range(K):
        for p in range(P):
            for i in range(k):
                for j in range(k):
                    work[i, j] = D[q, p, i, j]
            if p > 0:
                for i in range(k):
                    for j in range(k):
                        f = gains[q, p - 1, j, i]
                        for m in range(k):
                            work[i, m] -= f * E[q, p - 1, j, m]
                        for m in range(columns):
                            right[q, p, i, m] -= f * right[q, p - 1, j, m]
            log_pivot, _ = sweep(work)
            if np.isnan(log_pivot):
                return False
            log_det[q] += log_pivot
            for i in range(k):
                for j in range(k):
                    f = work[i, j]
                    pivots[q, p, i, j] = f
                    if p + 1 < P:
                        for m in range(k):
                            gains[q, p, i, m] += f * E[q, p, j, m]
                    for m in range(columns):
                        back[q, p, i, m] += f * right[q, p, j, m]
    return True


def eliminate_stops(D: Any, E: Any, right: Any) -> tuple[Any, Any, Any, Any]:
    """Eliminate the stops in order: see :func:`boxcal.calib.likelihood.chain.eliminate_stops`."""
    pivots, gains, back, log_det = np.empty(D.shape), np.zeros(D.shape), np.zeros(right.shape), np.zeros(len(D))
    if not _eliminate(D, E, right, pivots, gains, back, log_det):
        raise np.linalg.LinAlgError("Singular matrix")
    return pivots, gains, back, log_det


@kernel()
def substitute_back(gains: Any, back: Any) -> None:
    """Finish the solution: see :func:`boxcal.calib.likelihood.chain.substitute_back`."""
    K, P, k, columns = back.shape
    for q in range(K):
        for p in range(P - 2, -1, -1):
            for i in range(k):
                for j in range(k):
                    f = gains[q, p, i, j]
                    for m in range(columns):
                        back[q, p, i, m] -= f * back[q, p + 1, j, m]


@kernel()
def _covariances(pivots: Any, gains: Any, own: Any, cross: Any) -> None:
    K, P, k, _ = pivots.shape
    for q in range(K):
        for p in range(P - 1, -1, -1):
            for i in range(k):
                for m in range(k):
                    own[q, p, i, m] = pivots[q, p, i, m]
                if p + 1 < P:
                    for j in range(k):
                        f = gains[q, p, i, j]
                        for m in range(k):
                            cross[q, p, i, m] -= f * own[q, p + 1, j, m]
            if p + 1 < P:
                for i in range(k):
                    for m in range(k):
                        for j in range(k):
                            own[q, p, i, m] -= cross[q, p, i, j] * gains[q, p, m, j]


def chain_covariances(pivots: Any, gains: Any) -> tuple[Any, Any]:
    """Return the stops' covariances: see :func:`boxcal.calib.likelihood.chain.chain_covariances`."""
    own, cross = np.empty(pivots.shape), np.zeros(pivots.shape)
    _covariances(pivots, gains, own, cross)
    return own, cross
