"""Normal equations of legs added to those of stops, in numpy: the reference that the compiled loops are held to."""

import numpy as np

from boxcal.target.arrays import Array, Ids

STOP = 5
"""Unknowns of a stop that a leg depends on."""
WHEELS = 3
"""Unknowns of the wheels, a leg's first columns; those of its two stops follow, then explanations'."""


def add_legs(  # noqa: PLR0917 - arrays in, arrays out
    jacobian: Array, residual: Array, information: Array, stops: Ids, shared: Ids, to: tuple[Array, ...]
) -> None:
    """Add the normal equations of legs for K information matrices to those of K systems, in place.

    Parameters
    ----------
    jacobian, residual : (N, 3, 13 + k), (N, 3)
        Of the legs, by the wheels' unknowns (3), those of their first and second stop (5 each), and explanations' (k).
    information : (K, N, 3, 3)
        Of the legs.
    stops : (N,)
        Their first stops, ascending; the second is the next.
    shared : (3 + k,)
        Where the unknowns of wheels and explanations stand among the n shared ones.
    to : (K, n, n), (K, n), (K, P, 5, 5), (K, P, 5, 5), (K, P, 5, n + 1)
        A and a of the shared unknowns, D and E of the stops, and the stops by the shared unknowns with their right-hand
        sides.
    """
    A, a, D, E, right = to
    J = np.swapaxes(jacobian, 1, 2) @ information
    H, g = J @ jacobian, (J @ residual[:, :, None])[..., 0]
    columns = np.r_[:WHEELS, WHEELS + 2 * STOP : jacobian.shape[2]]
    A[:, shared[:, None], shared] += H[:, :, columns[:, None], columns].sum(axis=1)
    a[:, shared] += g[:, :, columns].sum(axis=1)
    for first in (0, 1):
        at = np.arange(STOP) + WHEELS + first * STOP
        right[:, (stops + first)[:, None, None], np.arange(STOP)[:, None], shared] += H[:, :, at[:, None], columns]
        right[..., -1][:, stops + first] += g[:, :, at]
        D[:, stops + first] += H[:, :, at[:, None], at]
    one, other = np.arange(STOP) + WHEELS, np.arange(STOP) + WHEELS + STOP
    E[:, stops] += H[:, :, one[:, None], other]


def travelled(by_travel: Array, travel: Array, starts: Ids) -> Array:
    """Return how legs' displacements change with unknowns that change what the wheels roll in each sample, (N, 3, k).

    Parameters
    ----------
    by_travel : (2, 3, S)
        Displacement of its leg by the distance that the right and the left wheel rolled in each sample.
    travel : (S, 2, k), m
        That distance by the unknowns.
    starts : (N,)
        First sample of each leg.
    """
    by_sample = by_travel.transpose(2, 1, 0) @ travel
    return np.asarray(np.add.reduceat(by_sample, starts, axis=0))
