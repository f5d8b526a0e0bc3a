"""Information of a drive stop by stop: what all images and legs so far carry about shared unknowns and the last stop.

A leg couples neighbouring stops only, so a stop may be eliminated as soon as the next one stands: what remains is one
matrix of the shared unknowns and of the last stop's five (x, y, heading, two encoder errors), however long the drive.
Read backwards the same holds for the stops that follow. All functions take batches: N candidates at once.
"""

import numpy as np

from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.likelihood.problem import PER_STOP
from boxcal.calib.planning.goal import Quantities
from boxcal.target.arrays import Array

_FIRST, _SECOND = slice(3, 3 + PER_STOP), slice(3 + PER_STOP, 3 + 2 * PER_STOP)
_ENCODERS = 2


def first_stop(prior: Array, pictures: Array) -> Array:
    """Return the information after a first stop, (N, n + 5, n + 5), of shared unknowns and that stop.

    Parameters
    ----------
    prior : (n, n)
        Of the shared unknowns.
    pictures : (N, n + 3, n + 3)
        Information of each image about them and about x, y and heading.
    """
    n = len(prior)
    out = stop_alone(pictures)
    out[:, :n, :n] += prior
    return out


def stop_alone(pictures: Array) -> Array:
    """Return the information of images alone with their stops' encoder errors, (N, n + 5, n + 5)."""
    N, m = pictures.shape[:2]
    out = np.zeros((N, m + _ENCODERS, m + _ENCODERS))
    out[:, :m, :m] = pictures
    out[:, m:, m:] = np.eye(_ENCODERS)
    return out


def append(before: Array, legs: Array, pictures: Array) -> Array:
    """Return the information after one more stop, (N, n + 5, n + 5), the stop before it eliminated.

    Parameters
    ----------
    before : (n + 5, n + 5) or (N, n + 5, n + 5)
        Of shared unknowns and the last stop.
    legs : (N, 13, 13)
        Information of the wheels about the path from it: about (rR, rL, b), its five unknowns and the next stop's.
    pictures : (N, n + 3, n + 3)
        Information of the next stop's image.
    """
    return through(before, legs) + stop_alone(pictures)


def through(before: Array, legs: Array) -> Array:
    """Return the information of one side of legs about shared unknowns and the other side's stops, (N, n + 5, n + 5).

    Parameters
    ----------
    before, legs
        As for :func:`append`.
    """
    n = before.shape[-1] - PER_STOP
    out = np.zeros((len(legs), n + PER_STOP, n + PER_STOP))
    out[:, :n, :n] = before[..., :n, :n]
    out[:, WHEELS, WHEELS] += legs[:, :3, :3]
    out[:, WHEELS, n:] += legs[:, :3, _SECOND]
    out[:, n:, WHEELS] += legs[:, _SECOND, :3]
    out[:, n:, n:] = legs[:, _SECOND, _SECOND]
    across = np.zeros((len(out), n + PER_STOP, PER_STOP))
    across[:, :n] = before[..., :n, n:]
    across[:, WHEELS] += legs[:, :3, _FIRST]
    across[:, n:] = legs[:, _SECOND, _FIRST]
    own = before[..., n:, n:] + legs[:, _FIRST, _FIRST]
    return np.asarray(out - across @ np.linalg.solve(own, np.swapaxes(across, 1, 2)))


def reverse(legs: Array) -> Array:
    """Return legs' information with first and second stop changed round, for a drive read backwards."""
    order = [0, 1, 2, *range(_SECOND.start, _SECOND.stop), *range(_FIRST.start, _FIRST.stop)]
    return legs[..., order, :][..., order]


def of_shared(chain: Array) -> Array:
    """Return the information of the shared unknowns, (N, n, n), the last stop eliminated."""
    n = chain.shape[-1] - PER_STOP
    across = chain[..., :n, n:]
    return np.asarray(chain[..., :n, :n] - across @ np.linalg.solve(chain[..., n:, n:], np.swapaxes(across, -1, -2)))


def quantity_values(found: Quantities, information: Array) -> Array:
    """Return the quantities' standard deviations, (N, 6), for information (N, n, n) of the shared unknowns."""
    d = 1 / np.sqrt(np.einsum("...ii->...i", information))
    scaled = information * d[..., :, None] * d[..., None, :]
    right = np.swapaxes(found.rows * d[..., None, :], -1, -2)
    variance = np.sum(right * np.linalg.solve(scaled, right), axis=-2)
    return found.from_variances(np.maximum(variance, 0.0))
