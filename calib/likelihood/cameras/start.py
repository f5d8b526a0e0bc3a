"""A robot with several cameras as the solutions of each camera by itself have it: data, and where to begin."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.likelihood.cameras.equations import Levels, about
from boxcal.calib.likelihood.cameras.problem import Together, together
from boxcal.calib.likelihood.cameras.row import one_row
from boxcal.calib.likelihood.cameras.state import Mounted, RobotState
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.explanation import Explanation, in_pictures
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.outliers import first_leg_weights
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """Beginning of the solution of a robot with several cameras.

    Attributes
    ----------
    robot
        Its data.
    drives
        Its drives with the stops of all cameras.
    state, levels
        Values of all unknowns, and variance components.
    legs : (N,)
        Weights of the legs.
    """

    robot: Together
    drives: tuple[Correspondences, ...]
    state: RobotState
    levels: Levels
    legs: Array


def wheel_causes(fits: Sequence[Fit]) -> tuple[Explanation, ...]:
    """Return the explanations of what the wheels do that any camera's solution has, each once."""
    found: dict[tuple[str, ...], Explanation] = {}
    for fit in fits:
        for cause in fit.problem.explanations:
            if not in_pictures(cause):
                found.setdefault(cause.names, cause)
    return tuple(found.values())


def beginning(
    fits: Sequence[Fit],
    drives: Sequence[Sequence[Correspondences]],
    causes: tuple[Explanation, ...] | None = None,
) -> Start:
    """Return a robot with several cameras, from each camera's own solution of the same drives.

    ``causes`` are those in the wheels; if None, all that any camera's own solution has.

    Errors as of :func:`boxcal.calib.likelihood.cameras.row.one_row`.
    """
    kept = [[tuple(f.problem.stop[f.problem.drive == d].tolist()) for d in range(f.problem.drives)] for f in fits]
    row = one_row(drives, kept)
    causes = wheel_causes(fits) if causes is None else causes
    robot = together([f.problem for f in fits], [f.weights.corners for f in fits], row, fits[0].options, causes)
    best = min(range(len(fits)), key=lambda c: float(np.trace(fits[c].cov[WHEELS, WHEELS])))
    state = _state(robot, fits, best)
    levels = levels_of(fits[best].components, tuple(f.components.noise_scale for f in fits))
    legs = robot.problem.leg_known.astype(np.float64)
    if fits[0].options.find_faults:
        legs = first_leg_weights(robot.problem, about(robot, state, levels.scales).at)[0]
    return Start(robot=robot, drives=row.drives, state=state, levels=levels, legs=legs)


def levels_of(components: VarianceComponents, scales: tuple[float, ...]) -> Levels:
    """Return variance components of several cameras, with noise scales (C,) of their own."""
    values = {f.name: getattr(components, f.name) for f in fields(VarianceComponents)}
    return Levels(**{**values, "noise_scale": 1.0}, scales=scales)


def _state(robot: Together, fits: Sequence[Fit], best: int) -> RobotState:
    """Return the state that the solutions amount to: a stop stands where the camera puts it that saw most there."""
    P = len(robot.problem.drive)
    poses, lean, errors, most = np.zeros((P, 3)), np.zeros((P, 3)), np.zeros((P, 2)), np.zeros(P)
    cameras = []
    for fit, part in zip(fits, robot.parts, strict=True):
        seen = np.bincount(fit.problem.corner_stop, weights=fit.weights.corners, minlength=len(part.places))
        better = seen > most[part.places]
        rows = part.places[better]
        most[rows] = seen[better]
        poses[rows], lean[rows] = fit.state.poses[better], fit.state.lean[better]
        errors[rows] = fit.state.encoder_errors[better]
        growth = np.zeros(P)
        growth[part.places] = fit.state.growth
        cameras.append(
            Mounted(
                lens=fit.state.lens,
                T_body_cam=fit.state.T_body_cam,
                common_growth=fit.state.common_growth,
                growth=growth,
            )
        )
    values: dict[str, float] = {}
    for fit in fits:
        names = fit.problem.names[fit.problem.explained]
        values |= dict(zip(names, fit.state.explained.tolist(), strict=True))
    names = robot.problem.names[robot.problem.explained]
    body = replace(
        fits[0].state,
        wheels=fits[best].state.wheels,
        tilt=fits[best].state.tilt,
        shape=fits[best].state.shape,
        explained=np.array([values.get(name, 0.0) for name in names]),
        poses=poses,
        lean=lean,
        growth=np.zeros(P),
        encoder_errors=errors,
    )
    return RobotState(body=body, cameras=tuple(cameras))
