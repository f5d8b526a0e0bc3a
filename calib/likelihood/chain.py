"""Elimination along the chain of stops, in numpy: the reference that the compiled loops are held to.

All arrays carry a leading axis of K systems; blocks are 5 x 5, ``right`` has m columns.
"""

import numpy as np

from boxcal.target.arrays import Array


def eliminate_stops(D: Array, E: Array, right: Array) -> tuple[Array, Array, Array, Array]:
    """Eliminate the stops in order, each from the next; ``right`` is changed in place.

    Parameters
    ----------
    D : (K, P, 5, 5)
        Blocks of the stops.
    E : (K, P, 5, 5)
        Stop by the next stop.
    right : (K, P, 5, m)
        Right-hand sides; after the call what is left of them where each stop is eliminated.

    Returns
    -------
    pivots, gains : (K, P, 5, 5)
        Inverses of the blocks where they are eliminated, and these times E.
    back : (K, P, 5, m)
        Pivots times right-hand sides.
    log_det : (K,)
        Logarithms of the determinants of the stops' equations.

    Raises
    ------
    LinAlgError
        If nothing holds a stop.
    """
    P = D.shape[1]
    pivots, gains = np.empty_like(D), np.zeros_like(D)
    block = D[:, 0]
    for i in range(P):
        pivots[:, i] = inverse = np.linalg.inv(block)
        if i + 1 < P:
            gains[:, i] = G = inverse @ E[:, i]
            Gt = np.swapaxes(G, -1, -2)
            block = D[:, i + 1] - Gt @ E[:, i]
            right[:, i + 1] -= Gt @ right[:, i]
    return pivots, gains, pivots @ right, -np.sum(np.linalg.slogdet(pivots)[1], axis=1)


def substitute_back(gains: Array, back: Array) -> None:
    """Finish the solution (K, P, 5, m) in place, from the last stop to the first."""
    for i in range(back.shape[1] - 2, -1, -1):
        back[:, i] -= gains[:, i] @ back[:, i + 1]


def chain_covariances(pivots: Array, gains: Array) -> tuple[Array, Array]:
    """Return the inverse's blocks of each stop, and of each stop with the next (the last zero), (K, P, 5, 5) each."""
    P = pivots.shape[1]
    own, cross = np.empty_like(pivots), np.zeros_like(pivots)
    own[:, P - 1] = pivots[:, P - 1]
    for i in range(P - 2, -1, -1):
        cross[:, i] = -gains[:, i] @ own[:, i + 1]
        own[:, i] = pivots[:, i] - cross[:, i] @ np.swapaxes(gains[:, i], -1, -2)
    return own, cross
