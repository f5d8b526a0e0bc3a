"""Values of a fleet that the page's script sorts, filters and draws: a list for each column, repeated texts once."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np

from boxcal.calib.report.fleet_tables import PARAMETERS, Parameter, RobotRow
from boxcal.target.arrays import Array, Mask

_DIGITS = 10
"""Significant digits of values; sigmas have three."""


def fleet_data(
    rows: Sequence[RobotRow], order: Sequence[int], values: Array, sigmas: Array, odd: Mask
) -> dict[str, Any]:
    """Return what ``fleet.js``, ``spread.js`` and ``plot.js`` draw: robots in the order of ``rows``."""
    return {
        "robots": [r.robot for r in rows],
        "panels": panels(PARAMETERS, values, sigmas, odd),
        "rows": {
            "order": list(order),
            "level": [r.rank for r in rows],
            "linked": [int(bool(r.link)) for r in rows],
            "why": once([r.why for r in rows]),
            "stale": once([r.stale for r in rows]),
            "hardware": once([r.hardware for r in rows]),
            "straight": [_number(r.straight, _DIGITS) for r in rows],
            "straight_said": once([r.straight_text if r.straight is None else "" for r in rows]),
            "turn": [_number(r.turn and r.turn * 180 / np.pi, _DIGITS) for r in rows],
            "turn_said": once([r.turn_text if r.turn is None else "" for r in rows]),
            "stops": [r.stops for r in rows],
            "rms": [_number(r.rms, 4) for r in rows],
        },
    }


def panels(parameters: Sequence[Parameter], values: Array, sigmas: Array, odd: Mask) -> list[dict[str, Any]]:
    """Return values, their standard deviations and which are outliers, (N, n) each, a panel a parameter."""
    return [
        {
            "key": p.key,
            "name": p.name,
            "unit": p.unit,
            "digits": p.digits,
            "value": [_number(v * p.scale, _DIGITS) for v in values[:, k]],
            "sigma": [_number(s * p.scale, 3) for s in sigmas[:, k]],
            "odd": np.flatnonzero(odd[:, k]).tolist(),
        }
        for k, p in enumerate(parameters)
    ]


def once(texts: Sequence[str]) -> list[list[Any]]:
    """Return the different texts, and for each place which it is."""
    different = list(dict.fromkeys(texts))
    number = {text: k for k, text in enumerate(different)}
    return [different, [number[text] for text in texts]]


def _number(value: float | None, digits: int) -> float | None:
    return float(f"{value:.{digits}g}") if value is not None and isfinite(value) else None
