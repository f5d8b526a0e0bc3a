"""Solution of stops and frames on the move together, started from that of the stops."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.corner_residuals import corner_residuals
from boxcal.calib.likelihood.explanation import Columns, explained_columns
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.leg_residuals import leg_residuals
from boxcal.calib.likelihood.levenberg_marquardt import Linearization, Weights
from boxcal.calib.likelihood.moving.clock import Clocks
from boxcal.calib.likelihood.moving.noise import FrameNoise, local_sigmas
from boxcal.calib.likelihood.moving.rolling import with_rolling
from boxcal.calib.likelihood.moving.row import along, first_state, row_problem, row_weights, taken
from boxcal.calib.likelihood.moving.slip_within import SlipWithin, equations_with_slip, slip_modes
from boxcal.calib.likelihood.moving.system import Levels, Scan, System, scanned, solved_at, system
from boxcal.calib.likelihood.moving.weave import Woven, weave_drives
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State, retract
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids

FIRST_JITTER_S = 1e-3
REWOVEN_S = 2e-4
"""A change of the offset beyond this (s) sets the frames to new places on the path."""
STEPS = 10
DIVERGED = 3.0
"""Corners' squares this many times those at the start are of a solver that runs away."""
LONGEST_S = 1.0
"""Longer changes of the offset (s) leave the leg that a frame belongs to."""
CLOSE, ROUGH = 1e-2, 0.1
"""Promised decreases of the sum of squares at which the solver ends: a tenth of a standard deviation, and where more
steps follow, which square the error."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AboutFrames(Linearization):
    """The likelihood of stops and frames about one state; corners' residuals are less the slip within frames.

    Attributes
    ----------
    slipped
        What slip while frames were read takes from the corners; None where none shows.
    """

    slipped: SlipWithin | None

    @property
    def taken_by_slip(self) -> float:
        """Degrees of freedom that slip within frames takes from the corners."""
        return 0.0 if self.slipped is None else float(self.slipped.freedom.sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """Stops and frames on the move about one state.

    Attributes
    ----------
    woven, problem
        The data, in one row.
    clocks
        What the frames' places on the path allow for; what is left of it is among the unknowns.
    height : px
        Of the images.
    weights
        Of corners (those of frames hold the frames' noise) and legs.
    within : m/sqrt(m)
        Slip while a frame is read, over the corners' noise scale.
    at
        The likelihood about the state.
    """

    woven: Woven
    problem: Problem
    clocks: Clocks
    height: int
    weights: Weights
    within: float
    at: AboutFrames

    @property
    def state(self) -> State:
        """Values of all unknowns."""
        return self.at.state

    @property
    def clocks_left(self) -> Clocks:
        """Offsets and rates beyond those that the frames' places allow for."""
        return left_of(self.state, len(self.woven.drives))

    @property
    def all_of_clocks(self) -> Clocks:
        """Offsets and rates in all."""
        left = self.clocks_left
        return self.clocks.plus(left.late_s, left.rate)

    @property
    def moving_corners(self) -> Ids:
        """Corners of frames on the move."""
        return np.flatnonzero(np.isin(self.problem.corner_stop, self.woven.moving))


def left_of(state: State, drives: int) -> Clocks:
    """Return the clocks' unknowns of a state: they stand before the readout time, which is the last."""
    unknowns = state.explained[-1 - 2 * drives : -1]
    return Clocks(late_s=unknowns[:drives], rate=unknowns[drives:])


def joined(fit: Fit, drives: Sequence[Correspondences], frames: Ids, clocks: Clocks, noise: FrameNoise) -> Joint:
    """Return the stops of a solution with frames on the move between them, these where the wheels lead from the stops.

    Parameters
    ----------
    fit
        Solution of the stops.
    drives
        The drives.
    frames : (F,)
        Which of their frames to use, counted through all drives.
    clocks
        To begin with.
    noise
        Of the frames, to begin with.
    """
    woven = weave_drives(drives, _kept(fit), frames, clocks)
    problem = row_problem(fit, woven)
    return _about(fit, drives, (woven, problem), first_state(fit, woven, problem), clocks, noise)


def _kept(fit: Fit) -> list[Ids]:
    """Return the numbers of the stops that a solution is of, for each drive."""
    return [fit.problem.stop[fit.problem.drive == d] for d in range(fit.problem.drives)]


def _about(  # noqa: PLR0917 - stops and frames, and about what
    fit: Fit,
    drives: Sequence[Correspondences],
    data: tuple[Woven, Problem],
    state: State,
    clocks: Clocks,
    noise: FrameNoise,
) -> Joint:
    """Return stops and frames about a state."""
    woven, problem = data
    weights, height = row_weights(fit, woven, problem, noise), drives[0].image_size[1]
    within = noise.slip / fit.components.noise_scale
    at = _linearized(problem, state, weights, (woven.course, height), within)
    return Joint(woven=woven, problem=problem, clocks=clocks, height=height, weights=weights, within=within, at=at)


def _linearized(
    problem: Problem, state: State, weights: Weights, frames: tuple[Array, int], within: float
) -> AboutFrames:
    """Return the likelihood about a state, rows of moving frames (course and height) read one after the other."""
    columns: Columns = explained_columns(problem, state)
    corners = corner_residuals(problem, state, columns, spare=1)
    corners = with_rolling(problem, state, corners, *frames)
    modes = slip_modes(problem, state, corners, frames, within)
    corners, (normal, local, squares), slipped = equations_with_slip(problem, corners, weights.corners, modes)
    return AboutFrames(
        corner_normal=normal, corner_local=local, corner_squares=squares, corners=corners, state=state, columns=columns,
        legs=leg_residuals(problem, state, columns), slipped=slipped,
    )  # fmt: skip


def linearized(joint: Joint, state: State) -> AboutFrames:
    """Return the likelihood of stops and frames about another state."""
    return _linearized(joint.problem, state, joint.weights, (joint.woven.course, joint.height), joint.within)


def stepped(joint: Joint, levels: Levels, weight: Array) -> Joint:
    """Return the likelihood after a step, the mean of solutions at some levels by their weights (K,)."""
    return replace(joint, at=linearized(joint, _after(joint, levels, weight)))


def _after(joint: Joint, levels: Levels, weight: Array) -> State:
    """Return the state after the mean step of solutions at some levels, by their weights (K,)."""
    s = levels.solution
    d_shared, d_stops = weight @ s.d_shared, np.tensordot(weight, s.d_stops, 1)
    d_local = s.local_step(d_shared, d_stops) * levels.local_sigma
    return retract(joint.problem, joint.state, d_shared, d_stops, d_local)


def _rewoven(fit: Fit, drives: Sequence[Correspondences], joint: Joint, state: State, noise: FrameNoise) -> Joint:
    """Return stops and frames with the clocks of a state taken into the frames' places on the path."""
    count, old = len(drives), joint.woven
    left = left_of(state, count)
    clocks = joint.clocks.plus(left.late_s, left.rate)
    woven = weave_drives(drives, _kept(fit), old.frame[old.moving], clocks)
    same = np.array_equal(woven.frame, old.frame)
    problem = along(joint.problem, woven) if same else row_problem(fit, woven)
    source = np.empty(len(woven.frame), dtype=np.int64)
    source[woven.frame < 0] = np.flatnonzero(old.frame < 0)
    source[woven.moving] = old.moving[np.searchsorted(old.frame[old.moving], woven.frame[woven.moving])]
    explained = state.explained.copy()
    explained[-1 - 2 * count : -1] = 0.0
    state = taken(state, source, explained)
    return _about(fit, drives, (woven, problem), state, clocks, noise)


def maximised(
    fit: Fit, drives: Sequence[Correspondences], joint: Joint, noise: FrameNoise, close: float = CLOSE
) -> Joint | None:
    """Return the likelihood at its maximum for given noise; None if the solver does not get there."""
    slip, jitter = np.array([noise.slip]), np.array([noise.jitter_s])
    most = DIVERGED * float(joint.at.corner_squares.sum())
    for _ in range(STEPS):
        if not (joint.at.valid and joint.at.corner_squares.sum() <= most):
            return None
        levels = solved(fit, joint, noise, slip, jitter)
        promised = float(levels.solution.decrease[0])
        if promised < close:
            return joint
        state = _after(joint, levels, np.ones(1))
        woven = joint.woven
        change = np.abs(left_of(state, len(drives)).late(woven.drive, woven.since_s)).max()
        if change > LONGEST_S:
            return None
        if change > REWOVEN_S:
            joint = _rewoven(fit, drives, joint, state, noise)
        else:
            joint = replace(joint, at=linearized(joint, state))
    return None


def solved(fit: Fit, joint: Joint, noise: FrameNoise, slip: Array, jitter_s: Array) -> Levels:
    """Return the solutions about the state at levels of slip and jitter (K,); see :func:`solved_at`."""
    return solved_at(_system(fit, joint, noise, slip, jitter_s))


def scan(fit: Fit, joint: Joint, noise: FrameNoise, slip: Array, jitter_s: Array) -> Scan:
    """Return the likelihood about the state at levels of slip and jitter (K,); see :func:`scanned`."""
    return scanned(_system(fit, joint, noise, slip, jitter_s))


def _system(fit: Fit, joint: Joint, noise: FrameNoise, slip: Array, jitter_s: Array) -> System:
    sigma = sigmas(fit, joint, noise)
    return system(joint.problem, joint.woven, joint.at, fit.components, joint.weights, sigma, slip, jitter_s)


def sigmas(fit: Fit, joint: Joint, noise: FrameNoise) -> Array:
    """Return the standard deviations of the local unknowns of stops and frames, (P, 4)."""
    return local_sigmas(fit.components, noise, len(joint.woven.frame), joint.woven.moving)
