"""Judgements: levels, the limits between them, and how values are worded."""

from dataclasses import dataclass
from math import isfinite

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.results.verdict import Level, Reason

SYMBOLS = frozenset((*ORDER, "a1", "a2", "a3", "aR", "aL"))
"""Names whose case matters: rR is the right wheel's radius, R a rotation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Limits of one value of a calibration: up to which it is good, and up to which usable."""

    good: float
    usable: float

    def grade(self, value: float) -> Level:
        """Return the level of a value that is better when smaller; what is not finite is never good."""
        if isfinite(value) and value <= self.good:
            return Level.GOOD
        return Level.USABLE if isfinite(value) and value <= self.usable else Level.REDO


LIMITS = {
    "straight": Limit(good=0.20, usable=0.50),  # m after 10 m
    "heading": Limit(good=2.0, usable=5.0),  # deg after 10 m
    "turn": Limit(good=1.0, usable=3.0),  # deg after a whole turn
    "camera-angle": Limit(good=0.2, usable=1.0),  # deg
    "camera-place": Limit(good=0.005, usable=0.020),  # m
    "stops": Limit(good=-8, usable=-5),  # less the number of stops
    "around": Limit(good=180.0, usable=360.0),  # deg, largest gap between stops seen from the box
    "turned": Limit(good=-60.0, usable=-30.0),  # deg, less the largest turn between two stops
    "legs": Limit(good=0.0, usable=0.25),  # fraction of legs left out
    "slip": Limit(good=0.002, usable=0.03),  # m/sqrt(m)
    "sharpness": Limit(good=0.5, usable=2.0),  # px in an image of 640 px
    "fit": Limit(good=1.7, usable=4.0),  # times the corners' own scatter
    "corners": Limit(good=0.03, usable=0.15),  # fraction of corners left out
    "print": Limit(good=0.002, usable=0.005),  # relative
    "floor": Limit(good=1.0, usable=3.0),  # deg
    "held-out": Limit(good=2.0, usable=4.0),  # root mean square, in sigmas
    "wheels": Limit(good=0.05, usable=0.5),  # relative difference of the radii
    "moves": Limit(good=-0.05, usable=-0.005),  # less sigma4/sigma3
}


def graded(rule: str, value: float, text: str, advice: str) -> list[Reason]:
    """Return one reason, its level from the limits of its rule; where all is well there is no advice."""
    level = LIMITS[rule].grade(value)
    return [Reason(rule=rule, level=level, text=text, advice="" if level is Level.GOOD else advice)]


def length(metres: float) -> str:
    """Return a length as people say it: mm below 1 cm, cm below 1 m."""
    if not isfinite(metres):
        return "an unknown length"
    if metres < 0.01:
        return f"{metres * 1e3:.2g} mm" if metres < 0.000995 else f"{metres * 1e3:.1f} mm"
    return f"{metres * 100:.1f} cm" if metres < 1 else f"{metres:.1f} m"


def angle(degrees: float) -> str:
    """Return an angle in degrees, to two significant digits."""
    if not isfinite(degrees):
        return "an unknown angle"
    return f"{degrees:.3f}°" if degrees < 0.0995 else f"{degrees:.2f}°"


def percent(fraction: float) -> str:
    """Return a fraction in percent, signed, to one tenth."""
    return f"{fraction:+.1%}".replace("-", "\N{MINUS SIGN}") if abs(fraction) >= 0.0005 else "0.0%"


def sentence(text: str) -> str:
    """Return a text with a capital and a full stop; a symbol at its beginning keeps its case."""
    first = text.partition(" ")[0].rstrip(",:")
    capital = text if first in SYMBOLS or any(c.isdigit() for c in first) else text[:1].upper() + text[1:]
    return capital + ("" if text.endswith((".", "?", "!")) else ".") if text else ""
