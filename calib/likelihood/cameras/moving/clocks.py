"""Clock and readout time of each of several cameras, as unknowns of the likelihood."""

from dataclasses import dataclass

from boxcal.calib.likelihood.cameras.problem import own_name
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.moving.clock import CameraClock
from boxcal.calib.likelihood.moving.rolling import ROLLING, Readout
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClockOf:
    """Offset and rate of one camera's stamps against the wheels'.

    Attributes
    ----------
    number
        Of the camera, from 1.
    clock
        What it does: the rates of the wheels are those at this camera's own frames, 0 elsewhere.
    """

    number: int
    clock: CameraClock

    @property
    def names(self) -> tuple[str, ...]:
        """Its two unknowns, s and s/s."""
        return tuple(own_name(name, self.number) for name in self.clock.names)

    @property
    def prior(self) -> tuple[float, ...]:
        """Standard deviations beforehand, s and s/s."""
        return self.clock.prior

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return what rolls less before each of the camera's frames, and more behind it."""
        return self.clock.columns(problem, state)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadoutOf:
    """Readout time of one camera's frames; its columns are in the camera's own equations.

    Attributes
    ----------
    number
        Of the camera, from 1.
    """

    number: int

    @property
    def names(self) -> tuple[str, ...]:
        """Its one unknown, s."""
        return (own_name(ROLLING, self.number),)

    @property
    def prior(self) -> tuple[float, ...]:
        """Standard deviation beforehand, s."""
        return Readout().prior

    def columns(self, problem: Problem, state: State) -> Columns:
        """Return nothing: no leg sees it."""
        return Readout().columns(problem, state)
