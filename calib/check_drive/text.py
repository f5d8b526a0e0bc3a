"""Text of a check drive's result."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.check_drive.by_box import CheckedLeg
from boxcal.calib.check_drive.by_hand import Measured
from boxcal.calib.console.tables import table

_OTHER_CAMERA = 4.0
"""Corners that err by more of their standard deviations were seen by another camera than the calibrated one."""
_NOT_ITS_CAMERA = (
    "not as predicted: the corners do not fit the calibration's camera; "
    "is it another robot's log, or was the lens touched?"
)
_CAUSES = (
    "not as predicted: were the parameters applied (ros2 param get), did a wheel slip or the box move? "
    "Drive again; if it stays, calibrate again"
)


def by_box(legs: Sequence[CheckedLeg], level: float) -> tuple[str, bool]:
    """Return a table of the legs with the conclusion, and whether all go as predicted at a significance level."""
    header = ["leg", "rolled m", "turned deg", "forward mm", "left mm", "heading deg", "in sigmas", "p"]
    rows = []
    for leg in legs:
        error, sigma = leg.error * (1e3, 1e3, np.degrees(1)), leg.sigma * (1e3, 1e3, np.degrees(1))
        rows.append(
            [f"{leg.start + 1} to {leg.end + 1}", f"{leg.rolled:.2f}", f"{np.degrees(leg.turned):.0f}"]
            + [f"{e:+.{d}f} +- {s:.{d}f}" for e, s, d in zip(error, sigma, (1, 1, 2), strict=True)]
            + [f"{np.sqrt(leg.chi_square / 3):.1f}", f"{leg.p_value:.2g}"]
        )
    least = min(leg.p_value for leg in legs)
    agrees = least * len(legs) >= level  # Bonferroni: any one of the legs may be the worst
    said = "as predicted: every leg ends where the calibration says, within its sigmas"
    if not agrees:
        said = _NOT_ITS_CAMERA if max(leg.corner_rms for leg in legs) > _OTHER_CAMERA else _CAUSES
    return f"odometry minus vision, with predicted sigmas\n{table(header, rows)}\n\n{said}", agrees


def by_hand(found: Sequence[tuple[str, Measured]], level: float) -> tuple[str, bool]:
    """Return each measured quantity with the conclusion, and whether all are as predicted at a significance level."""
    lines, agrees = [], True
    for what, m in found:
        unit, factor, digits = ("m", 1.0, 4) if what == "distance" else ("deg", float(np.degrees(1)), 2)
        a, b, s = m.odometry * factor, m.measured * factor, m.sigma * factor
        lines.append(
            f"{what} by the calibrated wheels {a:.{digits}f} {unit}, measured {b:.{digits}f}: {a - b:+.{digits}f} +- "
            f"{s:.{digits}f} {unit} ({(a - b) / b:+.2%}, {m.sigmas:+.1f} sigmas)"
        )
        agrees &= m.p_value * len(found) >= level
    lines.append("as predicted" if agrees else _CAUSES)
    return "\n".join(lines), agrees
