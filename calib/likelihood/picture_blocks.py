"""Normal equations of each stop's image by itself, its own unknowns among them."""

import numpy as np

from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.corner_residuals import Corners
from boxcal.target.arrays import Array


def picture_blocks(corners: Corners, weight: Array, local_sigma: Array) -> tuple[Array, Array]:
    """Return the normal equations of each stop's corners by themselves, (P, n + 7, n + 7) and (P, n + 7).

    Unknowns are the n shared ones, the stop's pose, and its local unknowns in units of their standard deviations;
    priors are not in it.

    Parameters
    ----------
    corners
        About a state.
    weight : (L,)
        Of each corner, noise scale in it.
    local_sigma : (4,) or (P, 4)
        Standard deviations of the local unknowns.
    """
    H, g = group_blocks(corners, weight)
    stops = int(corners.group_stop[-1]) + 1
    sigma = np.broadcast_to(local_sigma, (stops, corners.J_local.shape[2]))[corners.group_stop]
    X = np.concatenate([corners.J_shared, corners.J_pose, corners.J_local * sigma[:, None, :]], axis=2)
    first = np.searchsorted(corners.group_stop, np.arange(stops))
    N = np.add.reduceat(np.swapaxes(X, 1, 2) @ H @ X, first, axis=0)
    return N, np.add.reduceat(np.einsum("gmi,gm->gi", X, g), first, axis=0)


def group_blocks(corners: Corners, weight: Array) -> tuple[Array, Array]:
    """Return each group's normal equations in the base columns: (G, m, m) and (G, m)."""
    rows = corners.jacobian, corners.residual, weight
    sums = backend().group_sums(rows, corners.group, len(corners.group_stop))
    return sums[:, :-1, :-1], sums[:, -1, :-1]
