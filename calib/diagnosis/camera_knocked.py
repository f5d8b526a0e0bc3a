"""A camera that was knocked: it sat elsewhere on the robot before some stop; the result holds from there on."""

from dataclasses import dataclass
from math import radians

import numpy as np

from boxcal.calib.diagnosis.cause import OfPictures, Solved
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State

_AXES = ("rx", "ry", "rz", "tx", "ty", "tz")
_ANGLE, _SMALL_ANGLE, _PLACE = radians(0.5), radians(0.1), 2e-3


@dataclass(frozen=True, slots=True)
class CameraKnocked(OfPictures):
    """Before a stop (counted over all drives) the extrinsics are moved by a right perturbation.

    Attributes
    ----------
    stop
        Which stop.
    shifted
        Whether the camera was shifted too, not only rotated: without, a smaller knock can be detected.
    small
        Whether angles of a tenth of a degree are expected, not of half a degree: a wide prior asks for more evidence
        than a small knock gives, a narrow one shrinks a large knock.
    """

    stop: int
    shifted: bool = True
    small: bool = False

    @property
    def family(self) -> str:
        """One family for all stops."""
        return "camera-knocked"

    @property
    def names(self) -> tuple[str, ...]:
        """Rotation about and translation along the camera's axes, rad and m."""
        kind = "knock" if self.shifted else "nudge" if self.small else "turn"
        return tuple(f"{kind}{self.stop}-{axis}" for axis in _AXES[: len(self.prior)])

    @property
    def prior(self) -> tuple[float, ...]:
        """Half a degree, or a tenth, and 2 mm about and along each axis."""
        return (_SMALL_ANGLE if self.small else _ANGLE,) * 3 + (_PLACE,) * 3 * self.shifted

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return the camera's motion at all stops before that one."""
        corners = np.zeros((len(problem.drive), len(state.lens) + 6, len(self.prior)))
        corners[: self.stop, len(state.lens) :] = np.eye(6)[:, : len(self.prior)]
        return Columns(corners=corners)

    def finding(self, solved: Solved, problem: Problem) -> Finding:
        """Return how far the camera was turned and shifted."""
        turned, sigma = np.degrees(solved.length(slice(0, 3)))
        how_far = ""
        if self.shifted:
            shifted, s_shifted = (1e3 * x for x in solved.length(slice(3, 6)))
            how_far = f" and {shifted:.1f} +- {s_shifted:.1f} mm"
        stop = int(problem.stop[self.stop])
        return Finding(
            cause=self.family,
            text=f"before stop {stop + 1} the camera was knocked: by {turned:.3f} +- {sigma:.3f} deg{how_far}; "
            "the result is that after the knock",
            advice="Fasten the camera.",
            adopted=True,
            stops=tuple(int(s) for s in problem.stop[: self.stop]),
            size=float(turned),
            sigma=float(sigma),
            unit="deg",
            p_value=solved.p_value,
        )
