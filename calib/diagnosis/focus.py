"""A lens whose focus or an image whose crop changed: from some stop on, or from stop to stop (autofocus)."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.diagnosis.cause import OfPictures, Reference, Solved, percent
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State

_PARTS = ("scale", "right", "down")
_LEAST = 2.0
"""Sigmas from which on a change is reported."""
SMALL, USABLE = 0.012, 0.03
"""Changes of the focal length that are allowed for, and that leave a result usable. The effect is in proportion to the
change; of the rest, its square, the sigmas know nothing, and at 2 % it is several of them."""
SMALL_VARIATION, USABLE_VARIATION = 0.007, 0.02
"""The same of its standard deviation from stop to stop."""
_BEYOND = "; that is so much that errors may be larger than their standard deviations"


@dataclass(frozen=True, slots=True)
class FocusChanged(OfPictures):
    """Before a stop (counted over all drives) focal length and principal point were others.

    Attributes
    ----------
    stop
        Which stop.
    at
        Reference.
    shifted
        Whether the principal point was another too: without, a smaller change of the focal length can be detected.
    """

    stop: int
    at: Reference
    shifted: bool = True

    @property
    def family(self) -> str:
        """One family for all stops."""
        return "focus-changed"

    @property
    def names(self) -> tuple[str, ...]:
        """Focal length (relative), principal point right and down (px)."""
        return tuple(f"focus{self.stop}-{part}" for part in _PARTS) if self.shifted else (f"zoom{self.stop}-scale",)

    @property
    def prior(self) -> tuple[float, ...]:
        """One per cent and 5 px."""
        return (0.01, 5.0, 5.0) if self.shifted else (0.01,)

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return the camera's change at all stops before that one."""
        corners = np.zeros((len(problem.drive), len(state.lens) + 6, 3))
        corners[: self.stop, :2, 0] = (self.at.fu, self.at.fv)
        corners[: self.stop, 2, 1] = corners[: self.stop, 3, 2] = 1.0
        return Columns(corners=corners[:, :, : len(self.prior)])

    def finding(self, solved: Solved, problem: Problem) -> Finding:
        """Return how the image changed."""
        scale, s_scale = -float(solved.values[0]), float(solved.sigma[0])
        shift, s_shift = solved.length(slice(1, 3)) if self.shifted else (0.0, 1.0)
        words = []
        if abs(scale) > _LEAST * s_scale:
            words.append(f"the focal length grew by {100 * scale:+.3f} +- {100 * s_scale:.3f} %")
        if shift > _LEAST * s_shift:
            words.append(f"the picture moved by {shift:.1f} +- {s_shift:.1f} px")
        stop = int(problem.stop[self.stop])
        return Finding(
            cause=self.family,
            text=f"before stop {stop + 1} focus or crop of the camera changed: "
            f"{' and '.join(words) or 'a little'}; the result is that after the change{_BEYOND * (abs(scale) > SMALL)}",
            advice="Switch autofocus, zoom and digital stabilisation off.",
            adopted=abs(scale) <= SMALL,
            blocks=abs(scale) > USABLE,
            stops=tuple(int(s) for s in problem.stop[: self.stop]),
            size=100 * scale,
            sigma=100 * s_scale,
            unit="%",
            p_value=solved.p_value,
        )


@dataclass(frozen=True, slots=True)
class FocusVaries(OfPictures):
    """At each stop the focal length is another: autofocus."""

    stops: int
    at: Reference

    @property
    def family(self) -> str:
        """One family."""
        return "focus-varies"

    @property
    def names(self) -> tuple[str, ...]:
        """Focal length at each stop, relative to their mean."""
        return tuple(f"focus-at-{j}" for j in range(self.stops))

    @property
    def prior(self) -> tuple[float, ...]:
        """A fifth of a per cent: what autofocus does between near and far."""
        return (2e-3,) * self.stops

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return the camera's change at each stop."""
        corners = np.zeros((len(problem.drive), len(state.lens) + 6, self.stops))
        j = np.arange(self.stops)
        corners[j, 0, j], corners[j, 1, j] = self.at.fu, self.at.fv
        return Columns(corners=corners)

    def finding(self, solved: Solved, problem: Problem) -> Finding:  # noqa: ARG002
        """Return how much the focal length varies."""
        n = self.stops
        centred = np.eye(n) - 1 / n
        spread = float(np.sqrt((solved.values @ centred @ solved.values + np.sum(centred * solved.cov)) / (n - 1)))
        sigma = spread / float(np.sqrt(2 * (n - 1)))
        return Finding(
            cause=self.family,
            text=f"the focal length varies by {percent(spread, sigma)} from stop to stop (autofocus)"
            f"{_BEYOND * (spread > SMALL_VARIATION)}",
            advice="Switch autofocus off and calibrate again; the result is a mean.",
            adopted=spread <= SMALL_VARIATION,
            blocks=spread > USABLE_VARIATION,
            size=100 * spread,
            sigma=100 * sigma,
            unit="%",
            p_value=solved.p_value,
        )
