"""Frames taken between stops: a few chosen by their information for their cost, and the tags measured in each.

A frame's information about wheels and camera extrinsics is how far the robot turned on a short path since the nearest
stop, and of the clocks how fast the wheels turn there. What it costs is a search that may fail, since the camera
may have turned away. Where the stops determine wheels and camera, views are predicted (``predicted_views``); else how
often a turn keeps the box in view is learned from the frames looked at so far.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from boxcal.detect.alignment.candidates import find_candidates
from boxcal.detect.alignment.detection import KnownCamera
from boxcal.detect.alignment.detector import detect_in_grey
from boxcal.detect.alignment.pyramid_search import FEW_TAGS
from boxcal.detect.alignment.tag_patterns import target_patterns
from boxcal.detect.image.bayer import even_mosaic, unnamed_mosaic
from boxcal.detect.image.bit_depth import DeepGrey
from boxcal.detect.image.gray import LEAST_SIDE_PX, to_levels
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.stops import Stop
from boxcal.detect.tags.averaging import FLOOR_PX, AveragedCorners
from boxcal.detect.tags.detections import TagSettings, detector_settings
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.detect.tags.predicted_views import ClockedViews
from boxcal.target.arrays import Array, Ids, Mask
from boxcal.target.box import Target

A_LEG, FEWEST, MOST = 0.6, 6, 40
"""Number of frames that are measured: for each leg, and at least and at most in all."""
LEAST_WITHOUT_STOPS, MOST_WITHOUT_STOPS = 12, 40
"""Frames that a robot needs which stood still at too few places, and the most that are measured."""
TOO_FEW_PLACES = "the robot stood still at fewer than three places"
"""What is said of such a robot."""
TRIED = 2.5
"""Frames looked at for each that is measured, at most."""
_MARGIN_NS = 50_000_000
"""Frames this near to a stand may be of a robot that settles."""
_LEAST_RATE = 0.2
"""Wheel rate (rad/s) below which a frame carries no information about the clocks."""
_CLOCK_S, _FAST = 0.1, 8.0
"""An error in time of this (s) counts as much as a turn; rates (rad/s) beyond count as this."""
_PATH = 0.5
"""Path (rad of a wheel) that counts besides the one rolled: what the readings' errors amount to."""
_TURNS = np.array([0.25, 0.5, 1.0, 1.5, 2.5])
"""Bounds of the classes of turns, as differences of the wheels' angles, rad."""
_MOST_TURN = 0.75
"""A turn beyond this (rad, as above) adds little information: then the path in between matters."""
_AT_ONCE = 8
"""Candidates whose views are predicted at once."""
_IN_VAIN = 8
"""Frames without the box after which no more are looked at, if none shows it and none was predicted to."""
_SURPRISES = 2
"""Frames without the box that was predicted (less those with it) from which on predictions choose no more."""
_USUALLY_SEEN = np.array([[3.0, 2.0, 0.5, 0.2, 0.1, 0.1], [3.0, 3.0, 2.5, 1.5, 1.0, 1.0]])
_USUALLY_MISSED = np.array([[0.2, 1.0, 2.5, 3.0, 3.0, 3.0], [0.1, 0.2, 0.5, 1.5, 2.0, 2.0]])
"""What is learned from: frames that showed the box, or not, behind and before a stop, by classes of turns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """Frames between stops.

    Attributes
    ----------
    frames : (F,)
        Rows of the recording's frames, ascending.
    side : (F,)
        Twice the number of the leg; one more where the stop behind it is nearer than the one before.
    turn, path : (F,), rad
        Difference of the wheels' angles, and their mean travel, since or until the nearer stop.
    rate : (F,), rad/s
        How fast the faster wheel turns.
    """

    frames: Ids
    side: Ids
    turn: Array
    path: Array
    rate: Array


def candidates(wheels: WheelSamples, stops: Sequence[Stop], stands: Sequence[Stop], t_ns: Ids) -> Candidates:
    """Return the frames between stops at which the wheels turn.

    Parameters
    ----------
    wheels
        All samples.
    stops
        Stops at which the box was seen, in order.
    stands
        All stands, seen or not.
    t_ns : (N,), ns
        Stamps of all frames.
    """
    t = wheels.t_ns
    phi = np.stack([wheels.phi_R, wheels.phi_L], axis=1)
    rolled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(phi, axis=0)).mean(axis=1))])
    ends = np.array([s.t_end_ns for s in stops])
    starts = np.array([s.t_start_ns for s in stops])
    leg = np.searchsorted(ends, t_ns) - 1
    between = (leg >= 0) & (leg < len(stops) - 1)
    for stand in stands:
        between &= (t_ns < stand.t_start_ns - _MARGIN_NS) | (t_ns > stand.t_end_ns + _MARGIN_NS)
    after = np.clip(np.searchsorted(t, t_ns), 1, len(t) - 1)
    rate = np.abs(phi[after] - phi[after - 1]).max(axis=1) / ((t[after] - t[after - 1]) / 1e9)
    whole = np.array([bool(np.all(wheels.covered[a:b])) for a, b in _samples(stops)])
    between &= (rate > _LEAST_RATE) & whole[np.clip(leg, 0, len(whole) - 1)]
    rows = np.flatnonzero(between)
    leg, at = leg[rows], t_ns[rows]

    def read(when: Ids, values: Array) -> Array:
        return np.asarray(np.interp(when - t[0], t - t[0], values))

    here = np.stack([read(at, phi[:, 0]), read(at, phi[:, 1])], axis=1)
    at_stops = np.array([(s.phi_R, s.phi_L) for s in stops])
    paths = np.stack(
        [read(at, rolled) - read(ends[leg], rolled), read(starts[leg + 1], rolled) - read(at, rolled)], axis=1
    )
    behind = (paths[:, 1] < paths[:, 0]).astype(np.int64)
    difference = here - at_stops[leg + behind]
    return Candidates(
        frames=rows,
        side=2 * leg + behind,
        turn=np.abs(difference[:, 0] - difference[:, 1]),
        path=paths[np.arange(len(rows)), behind],
        rate=rate[rows],
    )


def _samples(stops: Sequence[Stop]) -> list[tuple[int, int]]:
    return [(a.last_sample + 1, b.first_sample + 1) for a, b in pairwise(stops)]


@dataclass(slots=True, kw_only=True, eq=False)
class Choice:
    """The next frame to look at, given what those before it showed.

    Attributes
    ----------
    among
        The frames.
    seen, missed : (2, 6)
        How many frames showed the box, and did not, behind and before their stop, by classes of turns; to begin with
        what is usual.
    left : (F,)
        What a frame adds, if it shows the box: less where its side of the leg has some.
    in_view
        Returns whether the box is predicted to be in view of some candidates (N,); None if nothing is predicted.
    surprises
        How many frames did not show a box that was predicted, less those that did.
    shown, in_vain
        How many of the frames looked at showed the box, and did not.
    nowhere
        Whether no frame was predicted to show the box, which some may all the same: a few are looked at.
    """

    among: Candidates
    in_view: Callable[[Ids], Mask] | None = None
    surprises: int = 0
    shown: int = 0
    in_vain: int = 0
    nowhere: bool = False
    seen: Array = field(default_factory=_USUALLY_SEEN.copy)
    missed: Array = field(default_factory=_USUALLY_MISSED.copy)
    left: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        information = (
            np.minimum(self.among.turn, _MOST_TURN) ** 2 + (_CLOCK_S * np.minimum(self.among.rate, _FAST)) ** 2
        )
        self.left = information / (_PATH + self.among.path)

    @property
    def _kind(self) -> tuple[Ids, Ids]:
        return self.among.side % 2, np.searchsorted(_TURNS, self.among.turn)

    def next(self) -> int | None:
        """Return the candidate to look at next; None if none is left."""
        if self.in_view is not None and self.surprises < _SURPRISES:
            left, predicted = self.left.copy(), self._next_in_view(self.in_view)
            if predicted is not None or self.shown + self.in_vain > 0:
                return predicted
            self.left, self.in_view, self.nowhere = left, None, True
        if self.nowhere and self.shown == 0 and self.in_vain >= _IN_VAIN:
            return None
        kind = self._kind
        gain = self.left * self.seen[kind] / (self.seen[kind] + self.missed[kind])
        best = int(np.argmax(gain)) if len(gain) else 0
        return best if len(gain) and gain[best] > 0 else None

    def _next_in_view(self, in_view: Callable[[Ids], Mask]) -> int | None:
        """Return the candidate that adds most among those predicted to show the box; None if none is left."""
        while np.any(self.left > 0):
            best = np.argsort(-self.left, kind="stable")[:_AT_ONCE]
            shown = in_view(best) & (self.left[best] > 0)
            if shown.any():
                return int(best[np.argmax(shown)])
            self.left[best] = 0
        return None

    def learn(self, at: int, *, shown: bool) -> None:
        """Take in whether a candidate showed the box."""
        kind, turn = self._kind[0][at], self._kind[1][at]
        if self.in_view is not None:
            self.surprises += -1 if shown else 1
        (self.seen if shown else self.missed)[kind, turn] += 1
        self.left[at] = 0
        self.shown, self.in_vain = self.shown + shown, self.in_vain + (not shown)
        if shown:
            self.left[self.among.side == self.among.side[at]] *= 0.15


class BoxOnTheMove:
    """Looks at single frames of a camera that is known from stops, where views are predicted at the tags first."""

    def __init__(
        self, target: Target, tags: TagSettings, camera: KnownCamera, views: ClockedViews | None = None
    ) -> None:
        self._target, self._tags, self._views = target, tags, views
        self._camera = replace(camera, round_inflation=0.0)  # an image on the move is always asked for its blur

    def at(self, image: DeepGrey, t_ns: int) -> MovingFrame | None:
        """Return what a frame shows; None if it shows too little of the box."""
        expected = None if self._views is None else self._views.expected(t_ns)
        mosaic = unnamed_mosaic(image)
        grey, grey8 = to_levels(image if mosaic is None else even_mosaic(image, mosaic))
        patterns, settings = target_patterns(self._target), detector_settings(self._tags)
        if expected is not None and not expected.within((image.shape[1], image.shape[0])).any():
            expected = None
        if expected is None and not any(
            len(find_candidates(grey8, patterns, settings.windows_px[:1], scale=scale).rows) >= FEW_TAGS
            for scale in (0.5, 1.0)
        ):
            return None  # sooner than a search that does not give up so easily
        found = detect_in_grey(grey, grey8, self._target, settings, self._camera, expected)
        if len(found.ids) < FEW_TAGS:
            if self._views is not None:
                self._views.missed(t_ns)
            return None
        ids = (4 * found.ids[:, None] + np.arange(4)).ravel()
        frame = _frame(t_ns, ids, found.corners_px.reshape(-1, 2), found.cov_px2.reshape(-1, 2, 2), self._target)
        (c, s), variance = found.blur_shape, float(np.median(found.blur_px**2))
        if self._views is not None:
            self._views.learn(t_ns, frame.p_box, frame.uv_px, (found.blur_shape, variance))
        return replace(frame, blur_px2=variance * np.array([[1 + c, s], [s, 1 - c]]))


def single_frame(t_ns: int, seen: AveragedCorners, target: Target) -> MovingFrame | None:
    """Return what a single frame showed that was measured as a stop is; None if it showed too little of the box."""
    if seen.tags < FEW_TAGS or seen.cov_px2 is None:
        return None
    return _frame(t_ns, seen.landmark_ids, seen.uv_px, seen.cov_px2, target)


def _frame(t_ns: int, ids: Ids, uv_px: Array, cov_px2: Array, target: Target) -> MovingFrame:
    return MovingFrame(
        t_ns=t_ns,
        landmark_ids=ids,
        p_box=target.p_box(ids),
        faces=target.faces(ids),
        uv_px=uv_px,
        cov_px2=cov_px2 + FLOOR_PX**2 * np.eye(2),
    )


def spread_frames(wheels: WheelSamples, t_ns: Ids) -> Ids:
    """Return frames of a robot that stood still at too few places, spread over its drive in ever finer steps.

    Frames count whose time the wheels' samples cover, by the travel of the wheels and not by time: a robot that waits
    shows one thing.

    Parameters
    ----------
    wheels
        All samples.
    t_ns : (N,), ns
        Stamps of all frames.
    """
    t = wheels.t_ns
    rolled = np.abs(np.diff(np.stack([wheels.phi_R, wheels.phi_L]), axis=1)).sum(axis=0)
    path = np.concatenate([[0.0], np.cumsum(rolled)])
    rows = np.flatnonzero((t_ns > t[0] + _MARGIN_NS) & (t_ns < t[-1] - _MARGIN_NS))
    if len(rows) == 0 or path[-1] <= 0:
        return rows[:0]
    at = np.interp(t_ns[rows] - t[0], t - t[0], path) / path[-1]
    places = [(2 * k + 1) / 2**level for level in range(1, 9) for k in range(2 ** (level - 1))]
    nearest = np.array([int(np.argmin(np.abs(at - place))) for place in places])
    return rows[list(dict.fromkeys(nearest.tolist()))]


def may_be_measured(tags: TagSettings, image_size: tuple[int, int]) -> bool:
    """Return whether single frames of this size are measured well enough to be used."""
    return tags.accurate and min(image_size) >= LEAST_SIDE_PX


def budget(legs: int) -> int:
    """Return how many frames on the move are measured on so many legs."""
    return min(max(round(A_LEG * legs), FEWEST), MOST)
