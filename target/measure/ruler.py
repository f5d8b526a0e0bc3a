"""From what a ruler read on the print and on the box to the box's measured dimensions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import Box, make_target
from boxcal.target.errors import TargetError
from boxcal.target.measure.measured_size import CREDIBLE, SIZES, Measured
from boxcal.target.measure.size_influence import scale_influence
from boxcal.target.print.page import BAR_LENGTH

SCALE_PRIOR = 0.003
"""How far a printer's scale is from 1 where nobody measured it, one sigma."""
SIZE_PRIOR = 0.001
"""How far a box is from its design where nobody measured it, m, one sigma."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """Readings of one length.

    Attributes
    ----------
    values : m
        One reading or several of the same length.
    sigma : m
        Of one reading.
    """

    values: tuple[float, ...]
    sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Length:
    """A length that can be read: which dimension it measures, and how long it was designed (m)."""

    figure: str
    designed: float


def lengths(box: Box) -> dict[str, Length]:
    """Return the lengths that can be measured on a box and its prints, by name."""
    across, up = ((n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows))
    return {
        "bar_x": Length(figure="sx", designed=BAR_LENGTH),
        "bar_y": Length(figure="sy", designed=BAR_LENGTH),
        "tags_x": Length(figure="sx", designed=across),
        "tags_y": Length(figure="sy", designed=up),
        "width": Length(figure="width", designed=box.width),
        "depth": Length(figure="depth", designed=box.depth),
        "height": Length(figure="height", designed=box.height),
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Conclusion:
    """The measured dimensions, and what they leave uncertain.

    Attributes
    ----------
    measured
        The dimensions, with covariance.
    read
        The names of the dimensions that were measured; the others are as designed, with a builder's usual error.
    scale, scale_sigma
        Of the box as a whole against its design.
    shares : (5,)
        What each dimension's own sigma adds to the variance of that scale, and ``ruler`` what the ruler does; together
        1.
    ruler
        Fraction of the error that all readings have in common.
    """

    measured: Measured
    read: frozenset[str]
    scale: float
    scale_sigma: float
    shares: Array
    ruler: float


def measure(box: Box, readings: Mapping[str, Readings], *, ruler_sigma: float) -> Conclusion:
    """Return what the readings say about a box.

    Lengths of the same dimension are combined by weighted least squares; readings that scatter more than their sigma
    raise it (Birge's ratio). The ruler's own error is common to all readings: it correlates all dimensions.

    Parameters
    ----------
    box
        As designed.
    readings
        By the names of :func:`lengths`.
    ruler_sigma
        Relative error of the ruler's own scale.

    Raises
    ------
    TargetError
        If there is no reading, or one is no length or more than 5 % from its design.
    """
    if not readings:
        raise TargetError(
            "no length was given", remedy="read at least the bars, width and depth with a ruler (--bar-x 99.8 ...)"
        )
    if not (isfinite(ruler_sigma) and 0 <= ruler_sigma <= CREDIBLE):
        raise TargetError(f"ruler's error is {ruler_sigma * 100:g} %: between 0 and {CREDIBLE * 100:g} % is needed")
    known = lengths(box)
    for name, reading in readings.items():
        _check(name, reading, known[name].designed)
    figures, own, common = np.zeros(len(SIZES)), np.zeros(len(SIZES)), np.zeros(len(SIZES))
    for k, figure in enumerate(SIZES):
        scale = figure in {"sx", "sy"}
        of_figure = [
            (known[name].designed if scale else 1.0, r) for name, r in readings.items() if known[name].figure == figure
        ]
        if of_figure:
            figures[k], own[k] = _combine(of_figure)
            common[k] = figures[k] * ruler_sigma
        else:
            figures[k] = 1.0 if scale else getattr(box, figure)
            own[k] = (SCALE_PRIOR if scale else SIZE_PRIOR) ** 2
    measured = Measured(
        **dict(zip(SIZES, map(float, figures), strict=True)), cov=np.diag(own) + np.outer(common, common)
    )
    influence = scale_influence(make_target(box, measured))
    variance = float(influence @ measured.cov @ influence)
    designed = np.array([1.0, 1.0, box.width, box.depth, box.height])
    return Conclusion(
        measured=measured,
        read=frozenset(known[name].figure for name in readings),
        scale=1 + float(scale_influence(make_target(box)) @ (figures - designed)),
        scale_sigma=variance**0.5,
        shares=influence**2 * own / variance,
        ruler=float(influence @ common) ** 2 / variance,
    )


def _check(name: str, reading: Readings, designed: float) -> None:
    option = "--" + name.replace("_", "-")
    if not reading.values:
        raise TargetError("no reading", source=option, remedy="give one or more in mm")
    if not (isfinite(reading.sigma) and 0 < reading.sigma <= CREDIBLE * designed):
        raise TargetError(
            f"its sigma is {reading.sigma * 1e3:g} mm, between 0 and {CREDIBLE * designed * 1e3:.3g} mm is needed",
            source=option,
            remedy="give what the ruler can be read to",
        )
    for value in reading.values:
        off = value / designed - 1
        if not abs(off) <= CREDIBLE:
            raise TargetError(
                f"{value * 1e3:g} mm was read, {designed * 1e3:.5g} mm was designed: {off:+.1%} off, at most "
                f"{CREDIBLE:.0%} is credible",
                source=option,
                remedy='was it printed with "fit to page"? print again at 100 %, or check the '
                "reading and its unit (mm)",
            )


def _combine(readings: Sequence[tuple[float, Readings]]) -> tuple[float, float]:
    """Return a dimension and its variance from (designed length or 1, readings of it)."""
    rows = [(designed, value, r.sigma) for designed, r in readings for value in r.values]
    designed, value, sigma = (np.array(column) for column in zip(*rows, strict=True))
    weight = designed / sigma**2
    information = float(weight @ designed)
    figure = float(weight @ value) / information
    scatter = float(np.sum(((value - designed * figure) / sigma) ** 2)) / max(len(rows) - 1, 1)
    return figure, max(1.0, scatter) / information
