"""Solver of a robot with several cameras, for given noise levels: damped Gauss-Newton from a state near by."""

import numpy as np

from boxcal.calib.likelihood.cameras.equations import About, Levels, about
from boxcal.calib.likelihood.cameras.problem import Together
from boxcal.calib.likelihood.cameras.state import RobotState, stepped
from boxcal.calib.likelihood.levenberg_marquardt import CONVERGED, Weights, equations, leg_information
from boxcal.calib.likelihood.stop_elimination import solve
from boxcal.target.arrays import Array

_MOST_STEPS = 60
_FIRST_DAMPING, _MOST_DAMPING, _FACTOR = 1e-6, 1e8, 10.0


def moved(robot: Together, state: RobotState, levels: Levels, step: tuple[Array, Array, Array]) -> RobotState:
    """Return the state after a step: shared unknowns, chain, and local unknowns in units of their sigma."""
    d_shared, d_stops, d_local = step
    return stepped(robot, state, d_shared, d_stops, d_local * levels.local_sigma)


def maximised(robot: Together, start: RobotState, levels: Levels, legs: Array) -> About:
    """Return the likelihood about its maximum for given noise levels and weights of the legs (N,)."""
    here = about(robot, start, levels.scales)
    information = leg_information(
        robot.problem, here.at.legs, Weights(corners=np.zeros(0), legs=legs), np.array(levels.slip)
    )
    normal, cost = equations(robot.problem, here.at, levels, information)
    damping = 0.0
    for _ in range(_MOST_STEPS):
        step = solve(normal.damped(damping) if damping else normal)
        if float(step.decrease) < CONVERGED:
            break
        trial = about(
            robot, moved(robot, here.state, levels, (step.d_shared, step.d_stops, step.d_local)), levels.scales
        )
        trial_normal, trial_cost = equations(robot.problem, trial.at, levels, information)
        if trial.valid and float(trial_cost) <= float(cost) * (1 + 1e-12):
            here, normal, cost = trial, trial_normal, trial_cost
            damping = damping / _FACTOR if damping > _FIRST_DAMPING else 0.0
            continue
        damping = max(damping * _FACTOR, _FIRST_DAMPING)
        if damping > _MOST_DAMPING:
            break
    return here
