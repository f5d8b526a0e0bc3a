"""Stops and frames on the move of all cameras in one row, at the times that each camera's clock gives them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.cameras.moving.clocks import ClockOf, ReadoutOf
from boxcal.calib.likelihood.cameras.problem import Part, Together, together
from boxcal.calib.likelihood.cameras.problem import own_name as named
from boxcal.calib.likelihood.cameras.row import Row
from boxcal.calib.likelihood.cameras.solve import RobotFit
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import RATE, CameraClock, Clocks, one_time, since_middle_s
from boxcal.calib.likelihood.moving.levels import Settled
from boxcal.calib.likelihood.moving.rolling import ROLLING, Readout
from boxcal.calib.likelihood.moving.row import FINEST_STEP
from boxcal.calib.likelihood.moving.weave import APART_S, Woven, weave
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """One camera of a robot: its stops, and its frames on the move as they were used by itself.

    Attributes
    ----------
    fit, drive
        Solution of its stops alone, and the drive as it saw it.
    settled
        Its stops and frames; None for a camera without frames that can be used.
    """

    fit: Fit
    drive: Correspondences
    settled: Settled | None

    @property
    def clock(self) -> Clocks:
        """Offset and rate of its clock, (1,), as it found them by itself."""
        return one_time(1) if self.settled is None else self.settled.joint.all_of_clocks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingRow:
    """Stops and frames of all cameras in one row.

    Attributes
    ----------
    robot
        The data.
    woven
        The row: its frames are numbered over all cameras.
    camera : (P,)
        The camera, from 0, of each frame in the row; -1 for stops.
    number : (P,)
        Which of its camera's frames it is; of a stop which of the row's stops.
    since_s : (P,), s
        Stamps of frames since the middle of their camera's.
    clocks
        Offsets and rates (C,) that the frames' places allow for.
    """

    robot: Together
    woven: Woven
    camera: Ids
    number: Ids
    since_s: Array
    clocks: Clocks


def clocks_of(cameras: Sequence[Seen]) -> Clocks:
    """Return the clocks of all cameras as each found its own by itself."""
    own = [seen.clock for seen in cameras]
    return Clocks(
        late_s=np.concatenate([clock.late_s for clock in own]), rate=np.concatenate([clock.rate for clock in own])
    )


def moving_row(
    stops: RobotFit,
    row: Correspondences,
    cameras: Sequence[Seen],
    clocks: Clocks,
    among: MovingRow | None = None,
) -> MovingRow:
    """Return all stops and frames of a robot in one row.

    Of frames of two cameras at one moment only one is used, that of the camera with fewer so far.

    Parameters
    ----------
    stops, row
        Solution of the stops of all cameras, and the drive with all those stops.
    cameras
        What each camera saw.
    clocks
        Offsets and rates (C,) of their clocks.
    among
        A row of the same data: only its frames are used. Chosen anew for each step of the clocks, frames of two cameras
        at one moment would change places for ever.
    """
    t_ns, camera, number = _frames(cameras, clocks, among)
    moving = [replace(cameras[c].drive.moving[k], t_ns=int(t)) for t, c, k in zip(t_ns, camera, number, strict=True)]
    every = replace(row, moving=tuple(moving))
    woven = weave(every, np.arange(len(row.stops)), np.arange(len(moving)), 0.0)
    woven = replace(woven, allowed={named(RATE, c): rate for c, rate in enumerate(clocks.rate.tolist(), 1)})
    of_place = np.where(woven.frame >= 0, camera[np.maximum(woven.frame, 0)], -1) if moving else woven.frame
    problems, corners, places = zip(
        *(_own(stops.robot.parts[c], seen, woven, of_place == c, number) for c, seen in enumerate(cameras)), strict=True
    )
    since_s = _since_s(cameras, camera, number, woven)
    own_clocks: list[Explanation] = []
    for c, seen in enumerate(cameras, 1):
        if seen.settled is not None:
            own = woven.rates * (of_place == c - 1)[:, None]
            clock = CameraClock(rates=own, since_s=since_s, drive=woven.drive, drives=1)
            own_clocks += [ClockOf(number=c, clock=clock), ReadoutOf(number=c)]
    causes = (*stops.robot.problem.explanations, *own_clocks)
    robot = together(problems, corners, Row(drives=woven.drives, places=places), cameras[0].fit.options, causes)
    parts = [
        part if seen.settled is None else _rolling(robot, replace(part, problem=own), woven.course, c, seen)
        for c, (part, own, seen) in enumerate(zip(robot.parts, problems, cameras, strict=True), 1)
    ]
    of_camera = np.cumsum(woven.frame < 0) - 1
    of_camera[woven.moving] = number[woven.frame[woven.moving]]
    robot = replace(robot, parts=tuple(parts))
    return MovingRow(robot=robot, woven=woven, camera=of_place, number=of_camera, since_s=since_s, clocks=clocks)


def _since_s(cameras: Sequence[Seen], camera: Ids, number: Ids, woven: Woven) -> Array:
    """Return how long after the middle of its camera's frames each frame in the row is stamped, (P,), s."""
    since = np.zeros(len(camera))
    for c in np.unique(camera).tolist():
        since[camera == c] = since_middle_s(cameras[c].drive, number[camera == c])
    return np.where(woven.frame >= 0, since[np.maximum(woven.frame, 0)], 0.0) if len(since) else woven.since_s


def _frames(cameras: Sequence[Seen], clocks: Clocks, among: MovingRow | None) -> tuple[Ids, Ids, Ids]:
    """Return times (ns), cameras and numbers of the frames to use, in order of time."""
    chosen = None if among is None else set(zip(among.camera.tolist(), among.number.tolist(), strict=True))
    found: list[tuple[int, int, int]] = []
    for c, seen in enumerate(cameras):
        if seen.settled is not None:
            there = seen.settled.joint.woven
            frames = there.frame[there.moving]
            late_ns = np.rint(1e9 * clocks.late(c, since_middle_s(seen.drive, frames))).astype(np.int64)
            found += [
                (seen.drive.moving[k].t_ns - late_ns[i], c, k)
                for i, k in enumerate(frames.tolist())
                if chosen is None or (c, k) in chosen
            ]
    kept: list[tuple[int, int, int]] = []
    count = np.zeros(len(cameras), dtype=np.int64)
    for frame in sorted(found):
        if kept and frame[0] - kept[-1][0] <= APART_S * 1e9:
            before = kept[-1][1]
            # of equal counts not the earlier frame: of two stamps that jitter it is the one that came early
            if (count[frame[1]], frame[1]) >= (count[before] - 1, before):
                continue
            count[kept.pop()[1]] -= 1
        kept.append(frame)
        count[frame[1]] += 1
    table = np.array(kept, dtype=np.int64).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def _own(part: Part, seen: Seen, woven: Woven, mine: Array, number: Ids) -> tuple[Problem, Array, Ids]:
    """Return one camera's problem of its stops and frames, its corners' weights, and their places in the row."""
    at_stops = np.flatnonzero(woven.frame < 0)[part.places]
    frames = np.flatnonzero(mine)
    places = np.sort(np.concatenate([at_stops, frames]))
    stop_of = dict(zip(at_stops.tolist(), range(len(at_stops)), strict=True))
    starts = seen.fit.problem.corner_starts
    stops: list[StopObservation] = []
    weights: list[Array] = []
    for place in places.tolist():
        there = woven.drives[0].stops[place]
        k = stop_of.get(place)
        if k is None:
            stops.append(there)
            weights.append(_frame_weights(seen, int(number[woven.frame[place]])))
            continue
        own = seen.drive.stops[int(seen.fit.problem.stop[k])]
        stops.append(replace(own, first_sample=there.first_sample, last_sample=there.last_sample))
        weights.append(part.corners[starts[k] : starts[k + 1]])
    drive = replace(seen.drive, wheels=woven.drives[0].wheels, stops=tuple(stops), moving=())
    explanations: tuple[Explanation, ...] = () if seen.settled is None else (Readout(),)
    options = replace(seen.fit.options, lens=seen.fit.problem.lens, explanations=explanations)
    step = max(seen.fit.problem.step, FINEST_STEP)
    problem = build_problem([drive], [tuple(range(len(stops)))], options, step)
    return with_floor(problem, seen.fit.problem.floor_px), np.concatenate(weights), places


def _frame_weights(seen: Seen, number: int) -> Array:
    """Return the weights of a frame's corners as the camera by itself has them."""
    if seen.settled is None:
        raise ValueError("a frame of a camera without frames")
    joint = seen.settled.joint
    place = int(np.flatnonzero(joint.woven.frame == number)[0])
    starts = joint.problem.corner_starts
    return joint.weights.corners[starts[place] : starts[place + 1]]


def _rolling(robot: Together, part: Part, course: Array, number: int, seen: Seen) -> Part:
    """Return a camera's data with its readout time among its unknowns."""
    column = robot.problem.names.index(named(ROLLING, number))
    return replace(
        part,
        columns=np.append(part.columns, column),
        course=course[part.places],
        within=0.0 if seen.settled is None else seen.settled.joint.within,
        height=seen.drive.image_size[1],
        readout=column - int(robot.problem.explained.start),
    )
