"""Wheel noise propagated along legs, in numpy: the reference that the compiled loop is held to."""

import numpy as np

from boxcal.calib.geometry.diff_drive import chord_lengths
from boxcal.calib.likelihood.wheel_path import WheelPath
from boxcal.target.arrays import Array, Ids

_PAIRS = np.array([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)])
_UNPACK = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
DRAGGED = 0.01
"""Fraction of the other wheel's distance that counts as a wheel's own: a wheel that pivots scrubs."""
SIDEWAYS = 1e-4
"""Variance of sideways drift over that of slip along the path: a hundredth in standard deviation."""


def propagate(path: WheelPath, wheels: Array, at_start: Array, at_end: Array, added: Array | None) -> tuple[Array, ...]:
    """Return the fields of :class:`boxcal.calib.likelihood.leg_model.LegModel`, in their order.

    Wheel speeds are taken as constant within a sample, so that a sample's path is an arc: its chord is
    ``ds sin(h)/h`` long and points h = dtheta/2 off the heading at its start.

    Parameters
    ----------
    path
        Wheel travel.
    wheels : (3,), m
        rR, rL, b.
    at_start, at_end : (N, 2), rad
        True angles of the right and the left wheel less their readings, at both ends of the legs.
    added : (S, 2), m
        Distance that the wheels rolled besides what their radii say.
    """
    radius, b = wheels[:2], wheels[2]
    dphi = _corrected(path, at_start, at_end)
    u = dphi * radius
    if added is not None:
        u = u + added
    ds, dth = u.sum(axis=1) / 2, (u[:, 0] - u[:, 1]) / b
    end_th = np.cumsum(dth)
    th = end_th - dth
    th = th - th[path.starts][path.leg]
    h = dth / 2
    sinc = np.sinc(h / np.pi)
    small = np.abs(h) < 1e-3
    dsinc = np.where(small, -h / 3 + h**3 / 30, (np.cos(h) - sinc) / np.where(small, 1.0, h))
    cos, sin = np.cos(th + h), np.sin(th + h)
    length = chord_lengths(ds, dth)
    end_x, end_y = np.cumsum(length * cos), np.cumsum(length * sin)
    last = np.append(path.starts[1:], len(ds)) - 1
    to_go_x, to_go_y = end_x[last][path.leg] - end_x, end_y[last][path.leg] - end_y
    # End pose by the sample's own ds and dth: the rest of the leg turns with dth.
    zero = np.zeros_like(ds)
    by_ds = np.stack([sinc * cos, sinc * sin, zero])
    by_sideways = np.stack([-sinc * sin, sinc * cos, zero])
    by_dth = np.stack(
        [
            0.5 * ds * (dsinc * cos - sinc * sin) - to_go_y,
            0.5 * ds * (dsinc * sin + sinc * cos) + to_go_x,
            np.ones_like(ds),
        ]
    )
    by_u = np.stack([by_ds / 2 + by_dth / b, by_ds / 2 - by_dth / b])  # (2, 3, S)
    first = path.starts
    rolled = np.abs(u)
    d_radius = np.add.reduceat(by_u * dphi.T[:, None, :], first, axis=2)  # (2, 3, N)
    d_b = np.add.reduceat(by_dth * (-dth / b), first, axis=1)
    displacement = np.stack(
        [
            np.add.reduceat(length * cos, first),
            np.add.reduceat(length * sin, first),
            np.add.reduceat(dth, first),
        ],
        axis=1,
    )
    d_start, d_end, quantisation = _readings(path, by_u, radius)
    return (
        displacement,
        np.stack([d_radius[0], d_radius[1], d_b]).transpose(2, 1, 0),
        d_start,
        d_end,
        _slip_covariance(by_u, by_sideways, rolled, first),
        quantisation,
        np.add.reduceat(rolled, first, axis=0),
        by_u,
        by_sideways,
    )


def _slip_covariance(by_u: Array, by_sideways: Array, rolled: Array, first: Ids) -> Array:
    """Return the legs' covariances for slip of 1 m/sqrt(m), (N, 3, 3)."""
    effective = rolled + DRAGGED * rolled[:, ::-1]
    products = by_u[:, _PAIRS[:, 0]] * by_u[:, _PAIRS[:, 1]]  # (2, 6, S)
    aside = by_sideways[_PAIRS[:, 0]] * by_sideways[_PAIRS[:, 1]] * (SIDEWAYS * rolled.sum(axis=1))
    slip = np.add.reduceat(np.einsum("wks,sw->ks", products, effective) + aside, first, axis=1)
    return np.asarray(slip.T[:, _UNPACK])


def _corrected(path: WheelPath, at_start: Array, at_end: Array) -> Array:
    """Return the travel in each sample, (S, 2) rad, with the readings at the legs' ends corrected.

    A wheel whose reading never changed on a leg may have turned by less than a step: its correction is spread evenly.
    """
    dphi = path.dphi.copy()
    count = np.diff(np.append(path.starts, len(dphi)))
    for wheel, moved in enumerate(path.moving):
        still = np.ones(path.legs, dtype=np.bool_)
        if len(moved):
            leg, first, last = _ends(path, moved)
            dphi[moved[first], wheel] -= at_start[leg[first], wheel]
            dphi[moved[last], wheel] += at_end[leg[last], wheel]
            still[leg[first]] = False
        if np.any(still):
            spread = np.where(still, (at_end - at_start)[:, wheel] / count, 0.0)
            dphi[:, wheel] += spread[path.leg]
    return dphi


def _ends(path: WheelPath, moved: Ids) -> tuple[Ids, Ids, Ids]:
    """Return the leg of each moving sample, and which of them are the first and the last of their legs."""
    leg = path.leg[moved]
    change = np.flatnonzero(np.diff(leg)) + 1
    return leg, np.concatenate([[0], change]), np.concatenate([change, [len(leg)]]) - 1


def _readings(path: WheelPath, by_u: Array, radius: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives by the readings at both ends, (N, 3, 2) each, and the covariance of those between.

    A reading's error is shared by all samples until the reading changes: only samples in which the wheel moved count,
    and each reading between two of them moves path length from one to the other.
    """
    n = path.legs
    d_start, d_end, quantisation = np.zeros((n, 3, 2)), np.zeros((n, 3, 2)), np.zeros((6, n))
    count = np.diff(np.append(path.starts, len(path.dphi)))
    for wheel, moved in enumerate(path.moving):
        still = np.ones(n, dtype=np.bool_)
        if len(moved):
            g = radius[wheel] * by_u[wheel][:, moved]
            leg, first, last = _ends(path, moved)
            still[leg[first]] = False
            d_start[leg[first], :, wheel] = -g[:, first].T
            d_end[leg[last], :, wheel] = g[:, last].T
            between = g[:, :-1] - g[:, 1:]
            between[:, first[1:] - 1] = 0.0
            if between.shape[1]:
                squares = between[_PAIRS[:, 0]] * between[_PAIRS[:, 1]] / 12
                bounds = np.minimum(first, between.shape[1] - 1)
                sums = np.add.reduceat(squares, bounds, axis=1)
                sums[:, first >= between.shape[1]] = 0.0
                quantisation[:, leg[first]] += sums
        if np.any(still):
            mean = np.add.reduceat(radius[wheel] * by_u[wheel], path.starts, axis=1).T / count[:, None]
            d_start[still, :, wheel] = -mean[still]
            d_end[still, :, wheel] = mean[still]
    return d_start, d_end, np.asarray(quantisation.T[:, _UNPACK])
