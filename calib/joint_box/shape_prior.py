"""Unknowns of a box that all robots share, and what is known of them before any robot drove."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.target_deformation import HAND_MADE, target_deformation
from boxcal.target.arrays import Array
from boxcal.target.box import Target, make_target
from boxcal.target.measure.refined_shape import SHAPE, RefinedShape


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapePrior:
    """Prior of the m unknowns of a box that its robots share: of its print's scales, its sheets, its faces, its bows.

    The ink's spread is not among them: a camera's response looks the same, so each robot has its own.

    Attributes
    ----------
    target
        The box as described.
    names : m
        Of :data:`~boxcal.target.measure.refined_shape.SHAPE`.
    sigma : (m,)
        Standard deviations where no component says them; infinite where there is none.
    component : m
        The variance component that each belongs to; empty where its prior is fixed.
    unit : (m,)
        Standard deviation of each over that of its component.
    information : (m, m)
        What was measured of them besides.
    """

    target: Target
    names: tuple[str, ...]
    sigma: Array
    component: tuple[str, ...]
    unit: Array
    information: Array

    @property
    def usual(self) -> dict[str, float]:
        """Variance components to start from: those of a box made by hand."""
        return {name: HAND_MADE[name] for name in sorted(set(self.component) - {""})}

    def equations(self, shape: Array, components: dict[str, float]) -> tuple[Array, Array]:
        """Return information (m, m) and score (m,) of the prior at a shape (m,), for given variance components."""
        sigma = np.array(
            [
                unit * components[name] if name else fixed
                for fixed, unit, name in zip(self.sigma, self.unit, self.component, strict=True)
            ]
        )
        weight = self.information + np.diag(1 / np.square(sigma))
        return weight, -weight @ shape

    def refined(self, shape: Array, cov: Array, drives: tuple[str, ...], robots: int) -> Target:
        """Return the target with a shape (m,) and its covariance (m, m), found from drives of a number of robots."""
        values, whole = np.zeros(len(SHAPE)), np.zeros((len(SHAPE), len(SHAPE)))
        at = [SHAPE.index(name) for name in self.names]
        values[at] = shape
        whole[np.ix_(at, at)] = cov
        refined = RefinedShape(values=values, cov=whole, robots=robots, drives=drives)
        return make_target(self.target.box, self.target.measured, refined)


def shape_prior(options: EstimateOptions) -> ShapePrior:
    """Return what is known of a box before any drive, under the options of the estimates.

    Raises
    ------
    CalibError
        If the options leave nothing of the box to find.
    """
    if options.target is None:
        raise CalibError("no target was given", needed="the box that all robots drove around is needed")
    described = options.target.unrefined
    found = target_deformation(replace(options, target=described), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    rows = [k for k, name in enumerate(found.names) if name != "ink"]
    if not rows:
        raise CalibError(
            "the box is taken as described: nothing of it is left to find",
            remedy="leave out the options that say so (--scale-prior-percent 0, --face-prior-mm 0, --bow-prior-mm 0)",
        )
    return ShapePrior(
        target=described,
        names=tuple(found.names[k] for k in rows),
        sigma=found.sigma[rows],
        component=tuple(found.component[k] for k in rows),
        unit=found.unit[rows],
        information=found.information[np.ix_(rows, rows)],
    )
