"""Deformations of the target beyond those of a careful user's box, in words.

The estimator solves for print, places, tilts and bows of all sheets anyway; here is said what of it matters.
"""

from collections.abc import Iterator

import numpy as np

from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.fit import Fit
from boxcal.target.box import FACES

LEAST = {"print": 0.002, "place": 6e-4, "turn": float(np.radians(0.3)), "bow": 6e-4}
"""From how much on print (relative), place, bow (m) and turn (rad) are reported: twice what a careful user gets."""
_SIGMAS = 3.5


def target_findings(fit: Fit) -> tuple[Finding, ...]:
    """Return what is said of the target as built."""
    return (*_print(fit), *_places(fit), *_turns(fit), *_bow(fit))


def _value(fit: Fit, name: str) -> tuple[float, float]:
    """Return an unknown of the target and its standard deviation; zeros if it is none."""
    if name not in fit.problem.names:
        return 0.0, 0.0
    k = fit.problem.names.index(name)
    return fit.problem.target.value(fit.state.shape, name), float(np.sqrt(fit.cov[k, k]))


def _large(value: float, sigma: float, kind: str) -> bool:
    return abs(value) > max(LEAST[kind], _SIGMAS * sigma)


def _print(fit: Fit) -> Iterator[Finding]:
    (x, sx), (y, sy) = _value(fit, "scale_x"), _value(fit, "scale_y")
    if not (_large(x, sx, "print") or _large(y, sy, "print")):
        return
    value, sigma = max((x, sx), (y, sy), key=lambda v: abs(v[0]))
    yield Finding(
        cause="print-scale",
        text=f"the sheets are printed at {100 * (1 + x):.2f} +- {100 * sx:.2f} % across and {100 * (1 + y):.2f} +- "
        f"{100 * sy:.2f} % up of their description",
        advice="Print at 100 % (no fitting to the page), or give the sizes to measure-target.",
        adopted=True,
        size=100 * value,
        sigma=100 * sigma,
        unit="%",
    )


def _places(fit: Fit) -> Iterator[Finding]:
    words = {"tx": ("to the right", "to the left"), "ty": ("high", "low"), "tz": ("outward", "inward")}
    for axis, (more, less) in words.items():
        each = [_value(fit, f"face{f}_{axis}") for f in range(FACES)]
        # All sheets alike to the right or high are the box' frame turned or raised: one sheet against most others.
        usual = float(np.median([value for value, _ in each])) if axis != "tz" else 0.0
        for f, (at, sigma) in enumerate(each):
            value = at - usual
            if _large(value, sigma, "place"):
                yield Finding(
                    cause=f"sheet-{f}-place",
                    text=f"sheet {f} sits {1e3 * abs(value):.2f} +- {1e3 * sigma:.2f} mm too far "
                    f"{more if value > 0 else less}",
                    adopted=True,
                    size=1e3 * value,
                    sigma=1e3 * sigma,
                    unit="mm",
                )


def _turns(fit: Fit) -> Iterator[Finding]:
    words = {"rx": "leans against the vertical", "ry": "is turned about the vertical", "rz": "is glued askew"}
    for f in range(FACES):
        for axis, what in words.items():
            value, sigma = _value(fit, f"face{f}_{axis}")
            if _large(value, sigma, "turn"):
                yield Finding(
                    cause=f"sheet-{f}-turn",
                    text=f"sheet {f} {what} by {np.degrees(abs(value)):.2f} +- {np.degrees(sigma):.2f} deg",
                    adopted=True,
                    size=float(np.degrees(value)),
                    sigma=float(np.degrees(sigma)),
                    unit="deg",
                )


def _bow(fit: Fit) -> Iterator[Finding]:
    bows = [_value(fit, f"bow{f}") for f in range(FACES)]
    bent = [f for f, (value, sigma) in enumerate(bows) if _large(value, sigma, "bow")]
    if not bent:
        return
    value, sigma = max((bows[f] for f in bent), key=lambda v: abs(v[0]))
    each = ", ".join(f"{f}: {1e3 * bows[f][0]:+.2f} +- {1e3 * bows[f][1]:.2f} mm" for f in bent)
    yield Finding(
        cause="bow",
        text=f"faces are not flat, they bow outward by (face: sagitta) {each}",
        advice="Glue the sheets to stiff board.",
        adopted=True,
        size=1e3 * value,
        sigma=1e3 * sigma,
        unit="mm",
    )
