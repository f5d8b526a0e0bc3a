"""Unit of wheel readings, inferred from the ratio of wheel radius to wheel separation.

The images fix every length, so the distance between the wheels comes out right whatever the readings' unit; the radii
come out smaller or larger by the unit. Wheels of real robots measure between 0.08 and 0.6 of the distance between them.
"""

from dataclasses import dataclass
from math import log, pi, radians

from boxcal.calib.likelihood.finding import Finding

USUAL_RATIO = 0.2
"""Radius over the distance between the wheels of usual robots (0.15 to 0.31: TurtleBots, Khepera, Pioneer, Husky)."""
_SPREAD = 0.4
"""Standard deviation of its logarithm."""
LEAST, MOST = 0.06, 0.75
"""Ratios outside this are no robot's."""
_COUNTS = 0.12
"""How near a whole number (or one over it) the ratio of the radii must be, as a logarithm."""
_WHOLE = 1e-6
_METRE = 0.02


@dataclass(frozen=True, slots=True)
class _Unit:
    """A unit: its name, its option, and how many rad one reading is."""

    name: str
    option: str
    rad: float


_UNITS = (
    _Unit("degrees", "--joint-unit deg", radians(1.0)),
    _Unit("turns", "--joint-unit turns", 2 * pi),
)


def judge_units(rR: float, rL: float, b: float, encoder_steps: tuple[float, float]) -> Finding | None:
    """Return what is said of wheels whose readings are no angles in rad; None if they are, or may be.

    Parameters
    ----------
    rR, rL, b : m
        As they came out.
    encoder_steps
        Difference between neighbouring readings, right and left, in the unit that the readings are in; 0 where none
        shows.
    """
    r = (rR * rL) ** 0.5
    counts = _counts(rR, rL)
    if counts is not None:
        return counts
    if LEAST < r / b < MOST:
        return None
    size = f"a wheel radius of {_length(r)} does not go with wheels {b * 1e3:.0f} mm apart"
    step = max(encoder_steps)
    whole = step >= 1 - _WHOLE and abs(step - round(step)) < _WHOLE
    text, advice = "", "say what they are with --joint-unit"
    if abs(log(r)) < _METRE and abs(log(rR / rL)) < _METRE:
        text, advice = "the readings are metres that each wheel rolled", "give --joint-unit m"
    elif whole and r / b < LEAST:
        ticks = 2 * pi * USUAL_RATIO * b / r
        text = f"the readings are whole numbers, encoder ticks (some {ticks:.0f} a turn for usual wheels)"
        advice = "give --joint-unit ticks --ticks-per-turn N"
    else:
        found = [(abs(log(r / unit.rad / b / USUAL_RATIO)) / _SPREAD, unit) for unit in _UNITS]
        worst, unit = min(found, key=lambda f: f[0])
        if worst < 1.5:
            text = f"the readings fit {unit.name} (wheels of {_length(r / unit.rad)})"
            if r < USUAL_RATIO * b / 2:
                text += f", or a motor before a gear of about {USUAL_RATIO * b / r:.0f}"
            advice = f"give {unit.option}"
        else:
            gear = USUAL_RATIO * b / r
            what = f"turns of the motor before a gear of about {gear:.0f}" if gear > 1 else "no angles of the wheel"
            text = f"the readings are {what}, encoder ticks, or another unit"
            advice = "give --joint-unit ticks --ticks-per-turn N, N = 2 pi times the gear's ratio (or ticks in a turn)"
            if worst < 3:
                text += f"; {unit.name} would make wheels of {_length(r / unit.rad)}"
    return Finding(
        cause="unit", text=f"{size}: {text}", advice=advice[:1].upper() + advice[1:] + ".", blocks=True, size=r / b
    )


def _counts(rR: float, rL: float) -> Finding | None:
    """Return what is said of a wheel whose readings count a whole number of times."""
    ratio = rR / rL
    times = round(max(ratio, 1 / ratio))
    if times < 2 or abs(log(max(ratio, 1 / ratio) / times)) > _COUNTS:
        return None
    wheel = "left" if ratio > 1 else "right"
    return Finding(
        cause="counts",
        text=f"the {wheel} wheel's readings count {times} times what the other's do (its radius comes out as "
        f"{min(ratio, 1 / ratio):.3f} of the other's)",
        advice="Check the counts or the gear's ratio that the driver takes for that wheel.",
        blocks=True,
        size=max(ratio, 1 / ratio),
        unit="times",
    )


def _length(metres: float) -> str:
    return f"{metres * 1e3:.3g} mm" if metres < 1 else f"{metres:.3g} m"
