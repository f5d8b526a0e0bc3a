"""The values that say how certain a calibration is, each on a scale of good, usable and poor."""

from dataclasses import dataclass
from math import isfinite, log10, pi

from boxcal.calib.assessment.limits import LIMITS, angle, length
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Detail

_WAY = 10.0


def slip_on_top(calibration: Calibration) -> str:
    """Return what the wheels' own slip adds over 10 m, in words; empty where slip is not known.

    Each wheel's path errs by slip times the root of its length, so the heading is a random walk, and the position aside
    is the walk's integral: a third of the path length squared times the heading's variance.
    """
    detail = calibration.detail
    if detail is None:
        return ""
    heading = detail.noise.slip * (2 * _WAY) ** 0.5 / calibration.wheels.b
    return f"{length(heading * _WAY / 3**0.5)} and {angle(heading * 180 / pi)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Gauge:
    """One value on a scale of good, usable and poor (logarithmic, 0 to 100)."""

    name: str
    text: str
    level: str
    at: float
    good: float
    usable: float


def gauges(detail: Detail | None) -> list[Gauge]:
    """Return what a robot's owner asks first; nothing without uncertainties."""
    if detail is None:
        return []
    g, sigma = detail.ground, detail.covariance.sigma
    turned = max(sigma[name] for name in ("rx", "ry", "rz")) * 180 / pi
    heading, turn = g.straight_heading * 180 / pi, g.turn_heading * 180 / pi
    return [
        _gauge("Position after 10 m straight ahead", length(g.straight_position), g.straight_position, "straight"),
        _gauge("Heading after 10 m straight ahead", angle(heading), heading, "heading"),
        _gauge("Heading after a whole turn", angle(turn), turn, "turn"),
        _gauge("Direction of the camera", angle(turned), turned, "camera-angle"),
    ]


def _gauge(name: str, text: str, value: float, rule: str) -> Gauge:
    limit = LIMITS[rule]
    low, high = limit.good / 30, limit.usable * 4

    def at(v: float) -> float:
        return round(100 * min(max(log10(v / low) / log10(high / low), 0.015), 0.985), 2)

    return Gauge(
        name=name,
        text=f"±\N{NO-BREAK SPACE}{text}" if isfinite(value) else "not determined",
        level=str(limit.grade(value)),
        at=at(value) if isfinite(value) and value > 0 else at(high if value > 0 else low),
        good=at(limit.good),
        usable=at(limit.usable),
    )
