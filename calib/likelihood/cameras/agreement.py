"""Agreement of a robot's cameras: whether each one's own solution fits that of all.

As for frames on the move (:mod:`boxcal.calib.likelihood.moving.agreement`), the difference of two solutions has the
difference of their covariances; but a camera that sees the box at few stops knows its slip badly, so the statistic is
one of F, not of chi-square.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtrc

from boxcal.calib.geometry.parameters import COUNT, ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood.cameras.solve import RobotFit
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array

CHANCE = 1e-4
"""Differences that are less probable than this disagree."""
_LEAST_GAIN = 0.15
"""Directions in which all cameras lessen the variance by a smaller fraction than this cannot be compared."""
_WHEELS = 3
"""Numbers that a leg gives, and unknowns of the wheels."""


def disagreement(fits: Sequence[Fit], fit: RobotFit) -> str:
    """Return which camera's own solution contradicts that of all cameras most, and in what; empty if none does.

    Cameras of other robots, of other drives, or on a part that moves against the wheels, show so.
    """
    worst, said = CHANCE / len(fits), ""
    for number, (alone, part) in enumerate(zip(fits, fit.robot.parts, strict=True)):
        columns = part.columns[:COUNT]
        own = alone.cov[:COUNT, :COUNT]
        if not (np.all(np.isfinite(own)) and np.all(np.diag(own) > 0)):
            continue
        change = _change(alone.state, fit.found.state.of(part, number))
        freedom = max(_WHEELS * (int(np.sum(alone.weights.legs > 0)) - 1), 1)
        p_value = _chance(change, own, fit.cov[np.ix_(columns, columns)], freedom)
        if p_value < worst:
            most = int(np.argmax(np.abs(change) / np.sqrt(np.diag(own))))
            sigmas = float(np.abs(change[most]) / np.sqrt(own[most, most]))
            worst = p_value
            said = (
                f"camera {number + 1} by itself gives another {ORDER[most]} ({sigmas:.1f} standard deviations; chance "
                f"of such differences {p_value:.1g})"
            )
    return said


def _change(alone: State, together: State) -> Array:
    """Return the reported parameters of one solution less those of another, (14,)."""
    R = alone.T_body_cam[:3, :3]
    return np.concatenate(
        [
            together.lens[:5] - alone.lens[:5],
            together.wheels - alone.wheels,
            log_so3(R.T @ together.T_body_cam[:3, :3]),
            R.T @ (together.T_body_cam[:3, 3] - alone.T_body_cam[:3, 3]),
        ]
    )


def _chance(change: Array, alone: Array, together: Array, freedom: int) -> float:
    """Return the chance of a change (14,) as large between solutions of covariances (14, 14), both right."""
    sigma = np.sqrt(np.diag(alone))
    values, vectors = np.linalg.eigh(alone / np.outer(sigma, sigma))
    whiten = (vectors / np.sqrt(np.maximum(values, 1e-12))).T / sigma
    gain, directions = np.linalg.eigh(np.eye(len(change)) - whiten @ together @ whiten.T)
    compared = gain > _LEAST_GAIN
    count = int(compared.sum())
    if not count:
        return 1.0
    square = float(np.sum((directions.T @ whiten @ change)[compared] ** 2 / gain[compared]))
    return float(fdtrc(count, freedom, square / count))
