"""The hook of an explanation: unknowns that may be added to the model, linear in their effect.

An explanation says how its k unknowns, all zero where nothing happened, change what the wheels travelled, where a leg
leads, or what a stop's camera sees. The same columns serve the score test at the present solution
(:mod:`boxcal.calib.likelihood.score_test`) and, once an explanation is part of the model, the solution itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from boxcal.target.arrays import Array

if TYPE_CHECKING:
    from boxcal.calib.likelihood.problem import Problem
    from boxcal.calib.likelihood.state import State


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns:
    """Derivatives of the data by the k unknowns of explanations; None where they change nothing.

    Attributes
    ----------
    travel : (S, 2, k), m
        Distance that the right and the left wheel rolled in each sample of the problem's wheel path.
    legs : (N, 3, k), m and rad
        Displacement ``(dx, dy, dtheta)`` by the wheels on each leg, in the body frame of its first stop.
    corners : (P, n_lens + 6, k)
        At each stop: the camera's coefficients (as in ``State.lens``), then the motion of the camera (rotation rad,
        translation m) as a right perturbation of ``T_box_cam``.
    """

    travel: Array | None = None
    legs: Array | None = None
    corners: Array | None = None


class Explanation(Protocol):
    """A cause that noise does not cover, with unknowns of its own."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its unknowns, unlike those of all others."""

    @property
    def prior(self) -> tuple[float, ...]:
        """Standard deviations of its unknowns beforehand (zero mean), in their own units; finite."""

    def columns(self, problem: "Problem", state: "State") -> Columns:
        """Return the effect of its unknowns about a state."""


def in_pictures(explanation: Explanation) -> bool:
    """Return whether an explanation changes what a camera sees; one that does not say so may."""
    return bool(getattr(explanation, "in_pictures", True))


def stacked(explanations: Sequence[Explanation], problem: "Problem", state: "State") -> Columns:
    """Return the columns of several explanations side by side."""
    parts = [(len(e.prior), e.columns(problem, state)) for e in explanations]
    shapes = {
        "travel": (len(problem.path.dphi), 2),
        "legs": (len(problem.leg_stop), 3),
        "corners": (len(problem.drive), len(state.lens) + 6),
    }
    out: dict[str, Array | None] = {}
    for field, shape in shapes.items():
        given = [getattr(columns, field) for _, columns in parts]
        if any(g is not None for g in given):
            blocks = [np.zeros((*shape, k)) if g is None else g for (k, _), g in zip(parts, given, strict=True)]
            out[field] = np.concatenate(blocks, axis=2)
    return Columns(**out)


def explained_columns(problem: "Problem", state: "State") -> Columns:
    """Return the columns of the explanations that are part of the model."""
    return stacked(problem.explanations, problem, state) if problem.explanations else Columns()
