"""Wheel samples: what the encoders of one robot read, and when."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import isfinite, pi, radians

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError
from boxcal.detect.log.choices import member
from boxcal.detect.log.encoder_step import encoder_step
from boxcal.target.arrays import Array, Ids

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelSamples:
    """Angles of the two wheels over time; positive angles roll the robot forward.

    Attributes
    ----------
    t_ns : (S,) int64, ns
        Header stamps, strictly ascending.
    phi_R, phi_L : (S,), rad
        Right and left wheel, unwrapped (not modulo a turn).
    encoder_steps : (right, left), rad
        Angle between neighbouring readings of each encoder as it was found in the log, 0 where there is none. Read off
        the angles if not given, which is right only where they are the encoders' own readings, not interpolated.
    covered : (S,) bool
        Whether the travel since the sample before is known: False after a time without readings, a reset of the
        counter, or a stray. The first sample counts as covered, and all do if not given.
    """

    t_ns: Ids
    phi_R: Array
    phi_L: Array
    encoder_steps: tuple[float, float] = (np.nan, np.nan)
    covered: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))

    def __post_init__(self) -> None:
        if self.covered.size == 0:
            object.__setattr__(self, "covered", np.ones(self.t_ns.shape, dtype=np.bool_))
        if not (self.t_ns.ndim == 1 and self.t_ns.shape == self.phi_R.shape == self.phi_L.shape == self.covered.shape):
            raise DetectError(
                f"wheel samples: found shapes {self.t_ns.shape}, {self.phi_R.shape}, {self.phi_L.shape} and "
                f"{self.covered.shape}; vectors of one length are needed"
            )
        if self.t_ns.size > 1 and not np.all(np.diff(self.t_ns) > 0):
            raise DetectError("wheel samples: times do not ascend; sort the samples and drop repeated stamps")
        if not (np.all(np.isfinite(self.phi_R)) and np.all(np.isfinite(self.phi_L))):
            raise DetectError("wheel samples: an angle is not finite; drop such samples")
        if any(np.isnan(step) for step in self.encoder_steps):
            steps = (encoder_step(self.phi_R), encoder_step(self.phi_L))
            object.__setattr__(self, "encoder_steps", steps)
        elif not all(np.isfinite(step) and step >= 0 for step in self.encoder_steps):
            raise DetectError(f"wheel samples: encoder steps {self.encoder_steps}, two numbers from 0 on are needed")

    def __len__(self) -> int:
        return int(self.t_ns.size)


class JointUnit(StrEnum):
    """A unit of wheel readings. METRES is the rim's travel: the radius that is found is then a factor near 1."""

    RADIANS = "rad"
    DEGREES = "deg"
    TICKS = "ticks"
    TURNS = "turns"
    METRES = "m"


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelUnits:
    """Units and signs of a robot's wheel readings.

    Attributes
    ----------
    unit
        Unit of both wheels' readings.
    ticks_per_turn
        Readings in a turn of the wheel; needed for ticks.
    reverse_left, reverse_right
        Whether a wheel's readings fall while it rolls forward.
    """

    unit: JointUnit = JointUnit.RADIANS
    ticks_per_turn: float | None = None
    reverse_left: bool = False
    reverse_right: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", member(JointUnit, self.unit, setting="unit", error=DetectError))
        ticks = self.ticks_per_turn
        if (self.unit is JointUnit.TICKS) != (ticks is not None):
            given = "wheel readings in ticks" if ticks is None else f"{ticks:g} ticks per turn"
            missing = "the ticks of a wheel's turn are needed" if ticks is None else f"readings are in {self.unit}"
            raise DetectError(given, needed=missing, remedy="give --joint-unit ticks --ticks-per-turn N together")
        if ticks is not None and not (isfinite(ticks) and ticks > 0):
            raise DetectError(f"{ticks} ticks per turn", needed="a positive number")

    @property
    def factors(self) -> tuple[float, float]:
        """Factors from readings of the right and the left wheel to rad (rolling forward is positive)."""
        size = {
            JointUnit.RADIANS: 1.0,
            JointUnit.DEGREES: radians(1.0),
            JointUnit.TICKS: 2 * pi / (self.ticks_per_turn or 1.0),
            JointUnit.TURNS: 2 * pi,
            JointUnit.METRES: 1.0,
        }[self.unit]
        return (-size if self.reverse_right else size, -size if self.reverse_left else size)
