"""Continuous cause of misfit: an explanation of the likelihood with its family and its sentence."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solved:
    """Size of an adopted explanation.

    Attributes
    ----------
    values : (k,)
        Of its unknowns.
    cov : (k, k)
        Their covariance.
    p_value
        Bound on the chance of data that speak as much for it without it: one over its Bayes factor.
    """

    values: Array
    cov: Array
    p_value: float

    @property
    def sigma(self) -> Array:
        """Standard deviations of the unknowns, (k,)."""
        return np.asarray(np.sqrt(np.diag(self.cov)))

    def length(self, rows: slice = slice(None)) -> tuple[float, float]:
        """Return the length of some unknowns as a vector, and its standard deviation."""
        v, C = self.values[rows], self.cov[rows, rows]
        size = float(np.linalg.norm(v))
        return size, float(np.sqrt(v @ C @ v)) / size if size > 0 else float(np.sqrt(np.trace(C)))


class Cause(Explanation, Protocol):
    """An explanation that can be named."""

    @property
    def family(self) -> str:
        """Explanations of one family are one cause at different stops: they share its rate of false alarms."""

    @property
    def in_pictures(self) -> bool:
        """Whether it changes what cameras see, not what wheels roll."""

    @property
    def unseen(self) -> dict[str, float]:
        """Standard deviations of what it may do besides that no drive can show, by reported parameter."""

    def possible(self, solved: Solved) -> bool:
        """Whether a size that was solved for is one that the cause can have."""

    def finding(self, solved: Solved, problem: Problem) -> Finding:
        """Return it in words, with its size."""


class OfWheels:
    """A cause that changes what wheels roll, and all that it does shows."""

    __slots__ = ()

    @property
    def in_pictures(self) -> bool:
        """No."""
        return False

    @property
    def unseen(self) -> dict[str, float]:
        """Nothing."""
        return {}

    def possible(self, solved: Solved) -> bool:  # noqa: ARG002 (any size is)
        """Yes, whatever the size."""
        return True


class OfPictures(OfWheels):
    """A cause that changes what cameras see."""

    __slots__ = ()

    @property
    def in_pictures(self) -> bool:
        """Yes."""
        return True


_FARTHEST = 20.0
"""Sizes beyond this many standard deviations of their prior are no sizes at all: the data are of something else."""


def can_be(cause: Cause, solved: Solved) -> bool:
    """Return whether a size that was solved for is one that the cause can have."""
    return bool(np.all(np.abs(solved.values) < _FARTHEST * np.array(cause.prior))) and cause.possible(solved)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Wheels and camera about which the effect of causes is linear; held, so that effects do not change as they move.

    Attributes
    ----------
    rR, rL, b : m
        Wheels.
    fu, fv : px
        Focal lengths.
    """

    rR: float
    rL: float
    b: float
    fu: float
    fv: float

    @classmethod
    def of(cls, state: State) -> "Reference":
        """Return the reference of a state."""
        rR, rL, b = (float(x) for x in state.wheels)
        return cls(rR=rR, rL=rL, b=b, fu=float(state.lens[0]), fv=float(state.lens[1]))

    @property
    def radii(self) -> Array:
        """Right and left, (2,), m."""
        return np.array([self.rR, self.rL])

    def travel(self, problem: Problem) -> Array:
        """Return the distance that round wheels roll in each sample, right and left, (S, 2), m."""
        return np.asarray(problem.path.dphi * self.radii)


def one_column(travel: Array) -> Array:
    """Return travel (S, 2) as the column of one unknown, (S, 2, 1)."""
    return np.asarray(travel[:, :, None])


def percent(value: float, sigma: float) -> str:
    """Return a fraction and its standard deviation in percent."""
    return f"{100 * value:.2f} +- {100 * sigma:.2f} %"
