"""Odometry of each leg with its derivatives and its covariance.

A leg's displacement ``(dx, dy, dtheta)`` is the pose of its second stop in the body frame of its first. Two kinds of
noise reach it, both propagated through the path that was really driven:

- *slip*: while a wheel rolls a distance d, the distance travelled differs from it by a random walk of variance
  ``slip^2 d``; slip in m/sqrt(m), independent for the two wheels. A wheel that stands while the other rolls scrubs a
  little, and both drift sideways a little (``DRAGGED``, ``SIDEWAYS``), so that no leg is taken as exact.
- *quantisation*: a reading differs from the wheel's angle by a uniform error of variance ``step^2 / 12``. The errors at
  the two stops act on the whole leg, and neighbouring legs share them: they are unknowns of their own (see
  ``State.encoder_errors``), so that nothing is counted twice. The errors of readings in between act on the path's shape
  only; they are added to the leg's covariance.
"""

from dataclasses import dataclass, fields

from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.wheel_path import WheelPath
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegModel:
    """Displacements of N legs, their derivatives and their covariances for unit noise.

    Attributes
    ----------
    displacement : (N, 3), m and rad
        ``(dx, dy, dtheta)`` in the body frame of the first stop; dtheta counts full turns.
    d_wheels : (N, 3, 3)
        By (rR, rL, b).
    d_start, d_end : (N, 3, 2), m/rad and rad/rad
        By the angles of the right and left wheel at the first and the last stop.
    slip : (N, 3, 3)
        Covariance for slip of 1 m/sqrt(m).
    quantisation : (N, 3, 3)
        Covariance from readings in between, for an encoder step of 1 rad.
    rolled : (N, 2), m
        Distance that each wheel rolled.
    by_travel : (2, 3, S)
        The leg's displacement by the distance that the right and the left wheel rolled in each sample.
    by_sideways : (3, S)
        The leg's displacement by a drift to the left in each sample, m.
    """

    displacement: Array
    d_wheels: Array
    d_start: Array
    d_end: Array
    slip: Array
    quantisation: Array
    rolled: Array
    by_travel: Array
    by_sideways: Array


def leg_model(path: WheelPath, wheels: Array, at_start: Array, at_end: Array, added: Array | None = None) -> LegModel:
    """Return what the wheels say about each leg.

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
    return LegModel(**dict(zip(_FIELDS, backend().propagate(path, wheels, at_start, at_end, added), strict=True)))


_FIELDS = tuple(field.name for field in fields(LegModel))
