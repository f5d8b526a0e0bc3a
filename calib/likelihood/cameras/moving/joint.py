"""Stops and frames of all cameras solved together, from the solution of the stops of all and from each camera's own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from boxcal.calib.likelihood.cameras.equations import About, Levels, about
from boxcal.calib.likelihood.cameras.moving.row import MovingRow, Seen, clocks_of, moving_row
from boxcal.calib.likelihood.cameras.problem import own_name
from boxcal.calib.likelihood.cameras.solve import RobotFit
from boxcal.calib.likelihood.cameras.state import RobotState, stepped
from boxcal.calib.likelihood.levenberg_marquardt import Weights
from boxcal.calib.likelihood.moving.clock import LATE, RATE, Clocks
from boxcal.calib.likelihood.moving.grid import Probable, over_levels
from boxcal.calib.likelihood.moving.levels import jitter_axis, slip_axis
from boxcal.calib.likelihood.moving.noise import local_sigmas
from boxcal.calib.likelihood.moving.row import led_by_wheels
from boxcal.calib.likelihood.moving.solve import CLOSE, DIVERGED, LONGEST_S, REWOVEN_S, STEPS
from boxcal.calib.likelihood.moving.system import Levels as Solutions
from boxcal.calib.likelihood.moving.system import Scan, System, scanned, solved_at, system
from boxcal.calib.likelihood.systematic_errors import systematic_covariance
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids

JITTER_S = 1e-3
"""Jitter that levels are counted in, s: each camera's own is in proportion to what it found by itself."""
_LEAST_JITTER_S = 1e-5
_ROUNDS = 3
_LIKELY = 0.01
_AT_REST = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ByGroup(Levels):
    """Levels whose local effects differ from stops to frames: ``sigma`` (G, 1, 4) for one camera's corners."""

    sigma: Array

    @property
    def local_sigma(self) -> Array:
        """Standard deviations of the local unknowns, (G, 1, 3 + C)."""
        return self.sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AllMoving:
    """Stops and frames of all cameras about one state.

    Attributes
    ----------
    row
        The data.
    here
        The likelihood about the state.
    levels
        Variance components of the stops.
    sigma : (P, 3 + C)
        Standard deviations of the local unknowns.
    legs : (N,)
        Weights of the legs.
    jitter : (P,)
        Jitter of each place over ``JITTER_S``; 0 at stops.
    """

    row: MovingRow
    here: About
    levels: Levels
    sigma: Array
    legs: Array
    jitter: Array

    @property
    def state(self) -> RobotState:
        """Values of all unknowns."""
        return self.here.state

    @property
    def clocks_left(self) -> Clocks:
        """Offsets and rates (C,) of the cameras' clocks beyond those that the frames' places allow for."""
        names = self.row.robot.problem.names[self.row.robot.problem.explained]
        said = dict(zip(names, self.state.body.explained.tolist(), strict=True))
        numbers = range(1, len(self.row.clocks.rate) + 1)
        late, rate = (np.array([said.get(own_name(name, c), 0.0) for c in numbers]) for name in (LATE, RATE))
        return Clocks(late_s=late, rate=rate)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SettledAll:
    """Stops and frames of all cameras at their maximum.

    Attributes
    ----------
    joint
        There.
    probable
        Levels of slip and jitter that are probable, and solutions about it at those.
    cov : (n, n)
        Of the shared unknowns, smooth errors of corners in it.
    """

    joint: AllMoving
    probable: Probable
    cov: Array


def settled_together(stops: RobotFit, row: Correspondences, cameras: Sequence[Seen]) -> SettledAll | None:
    """Return stops and frames of all cameras at their maximum; None if the solver does not get there.

    Parameters
    ----------
    stops, row
        Solution of the stops of all cameras, and the drive with all those stops.
    cameras
        What each saw, with the frames, clock offset, jitter, sway and corners' errors that it found by itself.
    """
    joint = _begun(stops, moving_row(stops, row, cameras, clocks_of(cameras)), cameras)
    reached = _maximised(stops, row, cameras, joint)
    if reached is None:
        return None
    joint = reached
    found: Probable | None = None
    for _ in range(_ROUNDS):
        slips = slip_axis(joint.row.robot.problem, joint.here.at, stops.profile, cameras[0].fit.options.slip)
        found = over_levels(partial(_scan, joint), slips, jitter_axis(), found)
        joint = _stepped(joint, found.levels, found.weight)
        if not joint.here.valid:
            return None
        if _left(joint, found) < _AT_REST:
            return SettledAll(joint=joint, probable=found, cov=_cov(joint, found, cameras))
    return None


def covariance_at(
    stops: RobotFit, row: Correspondences, cameras: Sequence[Seen], slip: float
) -> tuple[Array, AllMoving]:
    """Return the covariance of the shared unknowns for known noise, and where: frames where the wheels lead.

    That is the Cramer-Rao bound to first order. Arguments as of :func:`settled_together`.
    """
    joint = _begun(stops, moving_row(stops, row, cameras, clocks_of(cameras)), cameras)
    return _solved(joint, np.array([slip]), np.array([JITTER_S])).solution.cov[0], joint


def _begun(stops: RobotFit, row: MovingRow, cameras: Sequence[Seen], before: AllMoving | None = None) -> AllMoving:
    """Return the likelihood at the stops' solution, frames where the wheels lead; or at the state of ``before``."""
    woven, robot = row.woven, row.robot
    P = len(woven.frame)
    at_stops = np.flatnonzero(woven.frame < 0)
    sigma = np.tile(stops.levels.local_sigma, (P, 1))
    jitter = np.zeros(P)
    for c, seen in enumerate(cameras):
        mine = np.flatnonzero(row.camera == c)
        if seen.settled is not None and len(mine):
            sigma[mine] = local_sigmas(stops.levels, seen.settled.noise, P, mine)[mine]
            jitter[mine] = max(seen.settled.noise.jitter_s, _LEAST_JITTER_S) / JITTER_S
    state = _first_state(stops.found.state, row, at_stops, stops.robot.causes)
    if before is not None:
        state = _rewoven_state(before, row, state)
    legs = stops.legs[(np.cumsum(woven.frame < 0) - 1)[:-1]] * robot.problem.leg_known
    here = about(robot, state, stops.levels.scales)
    return AllMoving(row=row, here=here, levels=stops.levels, sigma=sigma, legs=legs, jitter=jitter)


def _first_state(state: RobotState, row: MovingRow, at_stops: Ids, causes: int) -> RobotState:
    robot, woven = row.robot, row.woven
    P = len(woven.frame)

    def of_stops(values: Array) -> Array:
        out = np.zeros((P, *values.shape[1:]))
        out[at_stops] = values
        return out

    body = state.body
    body = replace(
        body,
        explained=np.concatenate([body.explained[:causes], np.zeros(robot.causes - causes)]),
        poses=led_by_wheels(robot.problem, woven, body),
        lean=of_stops(body.lean),
        growth=np.zeros(P),
        encoder_errors=of_stops(body.encoder_errors),
    )
    return RobotState(body=body, cameras=tuple(replace(c, growth=of_stops(c.growth)) for c in state.cameras))


def _rewoven_state(before: AllMoving, row: MovingRow, fresh: RobotState) -> RobotState:
    """Return the state of an earlier row at the places of a new one: frames that were not there begin on the path."""
    old = before.row
    place = {(int(c), int(f)): k for k, (c, f) in enumerate(zip(old.camera, old.number, strict=True))}
    source = np.array([place.get((int(c), int(f)), -1) for c, f in zip(row.camera, row.number, strict=True)])
    known = np.flatnonzero(source >= 0)

    def taken(new: Array, earlier: Array) -> Array:
        out = new.copy()
        out[known] = earlier[source[known]]
        return out

    a, b = before.state.body, fresh.body
    explained = a.explained[: row.robot.causes].copy()
    for k, name in enumerate(row.robot.problem.names[row.robot.problem.explained][: row.robot.causes]):
        if name.endswith((LATE, RATE)):
            explained[k] = 0.0
    body = replace(
        a,
        explained=explained,
        poses=taken(b.poses, a.poses),
        lean=taken(b.lean, a.lean),
        growth=b.growth,
        encoder_errors=taken(b.encoder_errors, a.encoder_errors),
    )
    cameras = [
        replace(own, growth=taken(new.growth, own.growth))
        for own, new in zip(before.state.cameras, fresh.cameras, strict=True)
    ]
    return RobotState(body=body, cameras=tuple(cameras))


def _maximised(stops: RobotFit, row: Correspondences, cameras: Sequence[Seen], joint: AllMoving) -> AllMoving | None:
    """Return the likelihood at its maximum for the stops' slip and each camera's own jitter."""
    slip, jitter = np.array([stops.levels.slip]), np.array([JITTER_S])
    most = DIVERGED * float(joint.here.at.corner_squares.sum())
    for _ in range(STEPS):
        if not (joint.here.valid and joint.here.at.corner_squares.sum() <= most):
            return None
        solutions = _solved(joint, slip, jitter)
        if float(solutions.solution.decrease[0]) < CLOSE:
            return joint
        joint = _stepped(joint, solutions, np.ones(1))
        left, there = joint.clocks_left, joint.row
        change = max(
            float(np.abs(left.late(c, there.since_s[there.camera == c])).max(initial=0.0))
            for c in range(len(left.late_s))
        )
        if change > LONGEST_S:
            return None
        if change > REWOVEN_S:
            clocks = there.clocks.plus(left.late_s, left.rate)
            joint = _begun(stops, moving_row(stops, row, cameras, clocks, there), cameras, joint)
    return None


def _solved(joint: AllMoving, slip: Array, jitter_s: Array) -> Solutions:
    """Return the solutions about the state at levels of slip and jitter, (K,) each."""
    return solved_at(_system(joint, slip, jitter_s))


def _scan(joint: AllMoving, slip: Array, jitter_s: Array) -> Scan:
    """Return the likelihood about the state at levels of slip and jitter, (K,) each."""
    return scanned(_system(joint, slip, jitter_s))


def _system(joint: AllMoving, slip: Array, jitter_s: Array) -> System:
    woven = replace(joint.row.woven, course=joint.row.woven.course * joint.jitter[:, None, None])
    weights = Weights(corners=np.zeros(0), legs=joint.legs)
    problem = joint.row.robot.problem
    return system(problem, woven, joint.here.at, joint.levels, weights, joint.sigma, slip, jitter_s)


def _stepped(joint: AllMoving, solutions: Solutions, weight: Array) -> AllMoving:
    s = solutions.solution
    d_shared, d_stops = weight @ s.d_shared, np.tensordot(weight, s.d_stops, 1)
    d_local = s.local_step(d_shared, d_stops) * joint.sigma
    state = stepped(joint.row.robot, joint.state, d_shared, d_stops, d_local)
    return replace(joint, here=about(joint.row.robot, state, joint.levels.scales))


def _left(joint: AllMoving, found: Probable) -> float:
    """Return how far the shared unknowns would still go, a squared distance in their standard deviations."""
    solutions, weight = found.levels, found.weight
    likely = weight > _LIKELY * weight.max()
    again = _solved(joint, solutions.slip[likely], solutions.jitter_s[likely])
    step = (weight[likely] / weight[likely].sum()) @ again.solution.d_shared
    return float(step @ again.solution.information[int(np.argmax(weight[likely]))] @ step)


def _cov(joint: AllMoving, found: Probable, cameras: Sequence[Seen]) -> Array:
    """Return the covariance of the shared unknowns: levels' uncertainty and smooth errors of corners in it."""
    s, weight = found.levels.solution, found.weight
    off = s.d_shared - weight @ s.d_shared
    cov = np.tensordot(weight, s.cov, 1) + np.einsum("k,ki,kj->ij", weight, off, off)
    best = s.at(int(np.argmax(weight)))
    values = {name: getattr(joint.levels, name) for name in joint.levels.__dataclass_fields__}
    for c, (part, seen) in enumerate(zip(joint.row.robot.parts, cameras, strict=True)):
        at = joint.here.of(c)
        levels = _ByGroup(
            **values | {"noise_scale": joint.levels.scales[c]}, sigma=joint.sigma[at.corners.group_stop][:, None]
        )
        cov = cov + systematic_covariance(
            replace(part.problem, drive=joint.row.robot.problem.drive),
            at,
            levels,
            Weights(corners=part.corners, legs=joint.legs),
            best,
            share=seen.fit.options.systematic_share,
        )
    return np.asarray(cov)
