"""Normal equations of legs and sums over their samples, compiled: see :mod:`boxcal.calib.likelihood.leg_sums`."""

from typing import Any

import numpy as np

from boxcal.calib.likelihood.compiled.kernel import kernel
from boxcal.calib.likelihood.leg_sums import STOP, WHEELS


def add_legs(jacobian: Any, residual: Any, information: Any, stops: Any, shared: Any, to: Any) -> None:  # noqa: PLR0917
    """Add the legs' equations: see :func:`boxcal.calib.likelihood.leg_sums.add_legs`."""
    legs = tuple(np.ascontiguousarray(part) for part in (jacobian, residual, information))
    add_to(legs, np.ascontiguousarray(stops), np.ascontiguousarray(shared), to)


@kernel()
def add_to(legs: Any, stops: Any, shared: Any, to: Any) -> None:  # noqa: PLR0912
    """Add to A, a, D, E and the stops' right-hand sides; in a leg's columns its stops stand between the shared ones."""
    jacobian, residual, information = legs
    A, a, D, E, right = to
    n, m = A.shape[1], jacobian.shape[2]
    H, g, weighted = np.empty((m, m)), np.empty(m), np.empty(3)
    for q in range(len(information)):
        for leg in range(len(stops)):
            J, r, W, stop = jacobian[leg], residual[leg], information[q, leg], stops[leg]
            for i in range(m):
                for k in range(3):
                    weighted[k] = J[0, i] * W[0, k] + J[1, i] * W[1, k] + J[2, i] * W[2, k]
                g[i] = weighted[0] * r[0] + weighted[1] * r[1] + weighted[2] * r[2]
                for j in range(m):
                    H[i, j] = weighted[0] * J[0, j] + weighted[1] * J[1, j] + weighted[2] * J[2, j]
            for s in range(len(shared)):
                i = s if s < WHEELS else s + 2 * STOP
                a[q, shared[s]] += g[i]
                for t in range(len(shared)):
                    A[q, shared[s], shared[t]] += H[i, t if t < WHEELS else t + 2 * STOP]
            for end in range(2):
                for u in range(STOP):
                    i = WHEELS + end * STOP + u
                    right[q, stop + end, u, n] += g[i]
                    for t in range(len(shared)):
                        right[q, stop + end, u, shared[t]] += H[i, t if t < WHEELS else t + 2 * STOP]
                    for v in range(STOP):
                        D[q, stop + end, u, v] += H[i, WHEELS + end * STOP + v]
            for u in range(STOP):
                for v in range(STOP):
                    E[q, stop, u, v] += H[WHEELS + u, WHEELS + STOP + v]


def travelled(by_travel: Any, travel: Any, starts: Any) -> Any:
    """Return how displacements change: see :func:`boxcal.calib.likelihood.leg_sums.travelled`."""
    out = np.zeros((len(starts), 3, travel.shape[2]))
    add_travelled(np.ascontiguousarray(by_travel), np.ascontiguousarray(travel), np.append(starts, len(travel)), out)
    return out


@kernel()
def add_travelled(by_travel: Any, travel: Any, starts: Any, out: Any) -> None:
    """Add to out (N, 3, k); most entries of travel are zero."""
    for n in range(len(out)):
        for s in range(starts[n], starts[n + 1]):
            for w in range(2):
                for k in range(travel.shape[2]):
                    rolled = travel[s, w, k]
                    if rolled != 0.0:
                        for i in range(3):
                            out[n, i, k] += by_travel[w, i, s] * rolled
