"""Normal equations of corners: summed over each group, then taken to the unknowns that it depends on."""

from itertools import pairwise

import numpy as np

from boxcal.target.arrays import Array, Ids


def corner_sums(  # noqa: PLR0917 - arrays in, arrays out
    rows: tuple[Array, Array, Array], group: Ids, group_stop: Ids, stops: int, shared: Array, own: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return information and right-hand side of the shared unknowns and of each stop's own, and sums of squares.

    Shapes: (n, n), (n,), those between both (P, n, k), those of the own (P, k, k) and (P, k), and (P,).

    Parameters
    ----------
    rows : (L, 2, m), (L, 2), (L,)
        Derivatives of the corners by m columns, residuals and weights.
    group : (L,)
        Group of each corner.
    group_stop : (G,)
        Stop of each group, ascending.
    stops
        How many stops there are, P; some may have no group.
    shared, own : (G, m, n), (G, m, k)
        What the shared unknowns, and those of the stop alone, do in the m columns of each group.
    """
    m, n = rows[0].shape[2], shared.shape[2]
    N = group_sums(rows, group, len(group_stop))
    H, g = N[:, :m, :m], N[:, :m, m]
    by_shared, by_own = H @ shared, H @ own
    return (
        shared.reshape(-1, n).T @ by_shared.reshape(-1, n),
        g.ravel() @ shared.reshape(-1, n),
        by_stop(np.swapaxes(by_shared, 1, 2) @ own, group_stop, stops),
        by_stop(np.swapaxes(own, 1, 2) @ by_own, group_stop, stops),
        by_stop((g[:, None] @ own)[:, 0], group_stop, stops),
        by_stop(N[:, m, m], group_stop, stops),
    )


def group_sums(rows: tuple[Array, Array, Array], group: Ids, groups: int) -> Array:
    """Return the sums of products of derivatives and residuals over the corners of each group, (G, m + 1, m + 1).

    Parameters
    ----------
    rows, group
        As of :func:`corner_sums`.
    groups
        How many there are, G.
    """
    jacobian, residual, weight = rows
    m = jacobian.shape[2]
    scaled = np.concatenate([jacobian, residual[:, :, None]], axis=2)
    if not np.all(weight == 1):
        scaled *= np.sqrt(weight)[:, None, None]
    parts = [scaled[at].reshape(-1, m + 1) for at in groups_of(group, groups)]
    return np.array([part.T @ part for part in parts])


def groups_of(group: Ids, count: int) -> list[slice | Ids]:
    """Return the rows of each group: slices where the rows stand in order of their groups, as they mostly do."""
    if np.all(group[1:] >= group[:-1]):
        starts = np.searchsorted(group, np.arange(count + 1))
        return [slice(int(i), int(j)) for i, j in pairwise(starts)]
    return [np.flatnonzero(group == k) for k in range(count)]


def by_stop(values: Array, group_stop: Ids, stops: int) -> Array:
    """Return sums over the groups of each stop, (P, ...), of values (G, ...); zero at stops that have none."""
    out = np.zeros((stops, *values.shape[1:]))
    seen, first = np.unique(group_stop, return_index=True)
    out[seen] = np.add.reduceat(values, first, axis=0)
    return out
