"""Maximum likelihood of a robot with several cameras, from the solutions of each camera by itself."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.cameras.equations import About, Levels, about, rescaled
from boxcal.calib.likelihood.cameras.maximise import maximised, moved
from boxcal.calib.likelihood.cameras.problem import Together
from boxcal.calib.likelihood.cameras.state import RobotState
from boxcal.calib.likelihood.components import largest_change
from boxcal.calib.likelihood.leg_spread import spread_of, spread_weights
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights, equations, leg_information
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.outliers import LegMemory, LegTests, flag_legs, leg_tests
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.slip_profile import SlipProfile, fixed_profile, slip_profile
from boxcal.calib.likelihood.state import State
from boxcal.calib.likelihood.stop_elimination import solve
from boxcal.calib.likelihood.systematic_errors import systematic_covariance
from boxcal.calib.likelihood.variance_components import noise_scale, updated
from boxcal.target.arrays import Array

_ROUNDS, _INNER = 15, 30
_CLOSE, _SETTLED = 0.01, 0.03
"""Changes of the components, as logarithms, at which their fixed point, and the rounds, end."""
_SAME_WEIGHT = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotFit:
    """Solution of a robot with several cameras.

    Attributes
    ----------
    robot
        Its data.
    found
        The likelihood about the mean over slip.
    cov : (n, n)
        Of all shared unknowns (extrinsics: right perturbation), slip's uncertainty in it.
    levels, profile
        Variance components, and the levels of slip with their solutions.
    legs : (N,)
        Weights of the legs.
    tests
        Of the legs.
    converged
        Whether weights and components settled.
    """

    robot: Together
    found: About
    cov: Array
    levels: Levels
    profile: SlipProfile
    legs: Array
    tests: LegTests
    converged: bool

    @property
    def problem(self) -> Problem:
        """All unknowns, legs and priors."""
        return self.robot.problem

    @property
    def at(self) -> Linearization:
        """The likelihood of all about the mean over slip."""
        return self.found.at

    @property
    def state(self) -> State:
        """Values of the chain's unknowns."""
        return self.found.at.state

    @property
    def weights(self) -> Weights:
        """Weights of the legs; those of corners are in their cameras' equations."""
        return _weights(self.legs)

    @property
    def components(self) -> Levels:
        """Variance components."""
        return self.levels


def solved(robot: Together, start: RobotState, levels: Levels, legs: Array, options: EstimateOptions) -> RobotFit:
    """Return the solution of a robot with several cameras.

    Parameters
    ----------
    robot
        Its data.
    start, levels, legs
        State, components and weights of the legs (N,) to begin with.
    options
        Of the first camera.
    """
    state, memory, near, converged = start, LegMemory(), None, False
    for _ in range(_ROUNDS):
        here = maximised(robot, state, levels, legs)
        before, (levels, profile) = levels, _levels(robot, here, levels, legs, options, near)
        tests = leg_tests(robot.problem, here.at, _weights(legs), profile)
        old = legs
        if options.find_faults:
            kept = memory.settled(flag_legs(robot.problem, tests, _weights(legs), options.false_alarm))
            spread = memory.widest(spread_of(tests.square[kept > 0]) if options.slip is None else 0.0)
            legs = spread_weights(tests.expected_square, kept, spread)
        state, near = here.state, profile if np.array_equal(legs > 0, old > 0) else None
        same = bool(np.all(np.abs(legs - old) < _SAME_WEIGHT))
        if same and _change(before, levels) < max(_SETTLED, 0.2 * profile.sigma / profile.typical):
            converged = True
            break
    d_shared, d_stops, d_local, cov = profile.averaged()
    found = about(robot, moved(robot, here.state, levels, (d_shared, d_stops, d_local)), levels.scales)
    for number, part in enumerate(robot.parts):
        own = replace(part.problem, drive=robot.problem.drive)
        cov = cov + systematic_covariance(
            own,
            here.of(number),
            levels.of(number),
            Weights(corners=part.corners, legs=legs),
            profile.solution.at(profile.best),
            share=options.systematic_share,
        )
    return RobotFit(
        robot=robot,
        found=found,
        cov=cov,
        levels=levels,
        profile=profile,
        legs=legs,
        tests=tests,
        converged=converged,
    )


def _weights(legs: Array) -> Weights:
    """Return the legs' weights; those of corners are in their cameras' equations."""
    return Weights(corners=np.zeros(0), legs=legs)


def _levels(  # noqa: PLR0917 - a solution and what it is of
    robot: Together, here: About, levels: Levels, legs: Array, options: EstimateOptions, near: SlipProfile | None
) -> tuple[Levels, SlipProfile]:
    """Return all variance components about one state, and the profile of slip that belongs to them."""
    for _ in range(_INNER):
        information = leg_information(robot.problem, here.at.legs, _weights(legs), np.array(levels.slip))
        solution = solve(equations(robot.problem, here.at, levels, information)[0])
        joint = solution.joint_covariances()
        new = updated(robot.problem, here.at, levels, solution, joint)
        if not isinstance(new, Levels):
            raise TypeError("variance components of one camera where those of several are needed")
        if options.noise_scale is None:
            scales = [
                noise_scale(part.problem, here.of(c), levels.of(c), _corners(part.corners), solution, joint)[0]
                for c, part in enumerate(robot.parts)
            ]
            new = replace(new, scales=tuple(scales))
        change = max(largest_change(levels, new), _scales_change(levels.scales, new.scales))
        levels, here = new, rescaled(here, new.scales)
        if change < _CLOSE:
            break
    if options.slip is None and np.any(legs > 0):
        profile = slip_profile(robot.problem, here.at, levels, _weights(legs), near)
    else:
        profile = fixed_profile(robot.problem, here.at, levels, _weights(legs))
    return replace(levels, slip=profile.typical), profile


def _corners(weights: Array) -> Weights:
    return Weights(corners=weights, legs=np.zeros(0))


def _change(before: Levels, after: Levels) -> float:
    slip = abs(float(np.log(after.slip / before.slip)))
    return max(slip, largest_change(before, after), _scales_change(before.scales, after.scales))


def _scales_change(before: Sequence[float], after: Sequence[float]) -> float:
    return float(np.max(np.abs(np.log(np.array(after) / np.array(before)))))
