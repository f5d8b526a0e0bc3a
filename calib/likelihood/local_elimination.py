"""Local unknowns of the corners' equations eliminated, in numpy: the reference that the compiled loop is held to."""

import numpy as np

from boxcal.target.arrays import Array


def without_local(
    chain: tuple[Array, ...], local: tuple[Array, ...], weight: float, sigma: Array, unit: Array
) -> tuple[tuple[Array, ...], tuple[Array, ...], float, float]:
    """Return the corners' equations for some noise scale, without the local unknowns that have priors.

    These come back as (n, n), (P, 5, n + 1), (P, 5, 5), (n,): shared unknowns, stops by these and their right-hand
    sides, stops, and right-hand side; then how to find the local unknowns again, as
    :class:`boxcal.calib.likelihood.normal_equations.Eliminated` has it: inverse, by_shared, by_chain and c; then the
    part of the elimination in the sum of squares and in the logarithm of the determinant.

    Parameters
    ----------
    chain : (n, n), (P, n, 5), (P, 5, 5), (n,), (P, 5)
        Normal equations of the corners for noise scale 1: A, B, D, a and c.
    local : (P, q, q), (P, n, q), (P, 5, q), (P, q)
        Those of the local unknowns: D, by_shared, by_chain and c.
    weight
        Of the corners: one over the squared noise scale.
    sigma, unit : (P, q)
        Standard deviations of the local unknowns, and their values in these: where one is zero, nothing is left of it.
    """
    A, B, D, a, c = (weight * part for part in chain)
    n, q = len(a), sigma.shape[1]
    own = weight * local[0] * (sigma[:, :, None] * sigma[:, None, :]) + np.eye(q)
    inverse = np.asarray(np.linalg.inv(own), dtype=np.float64)
    with_shared, with_chain = (weight * part * sigma[:, None, :] for part in local[1:3])
    pull = weight * local[3] * sigma - unit
    by_shared, by_chain = inverse @ np.swapaxes(with_shared, 1, 2), inverse @ np.swapaxes(with_chain, 1, 2)
    alone = (inverse @ pull[..., None])[..., 0]
    right = np.empty((*c.shape, n + 1))
    right[..., :n] = np.swapaxes(B - with_shared @ by_chain, 1, 2)
    right[..., n] = c - np.einsum("pkq,pq->pk", with_chain, alone)
    return (
        (
            A - np.swapaxes(with_shared, 1, 2).reshape(-1, n).T @ by_shared.reshape(-1, n),
            right,
            D - with_chain @ by_chain,
            a - np.einsum("pnq,pq->n", with_shared, alone),
        ),
        (inverse, by_shared, by_chain, alone),
        float(np.sum(alone * pull)),
        -float(np.sum(np.linalg.slogdet(inverse)[1])),
    )
