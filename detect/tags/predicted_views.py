"""Views of the box that are predicted for frames between stops, and the clock offset under which they come true.

Predictions choose frames in which the box is in view, and say where its tags are looked for; no corner is drawn to
where it was predicted (see :mod:`boxcal.detect.alignment.expected_tags`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from boxcal.detect.alignment.expected_tags import ExpectedTags
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids, Mask
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraModel, project

_READABLE_PX = 9.0
"""Shortest side of a tag, px, from which on it is counted on."""
_STEP_S = 0.005
"""Difference in time from which the speed of corners is computed, s."""
_ROUNDS, _LONGEST_S, _SLIGHT_S = 3, 0.5, 1e-4
_DOUBT_S = 0.06
"""Offsets up to this must leave the box in view of frames that are looked at first, s."""
_APART, _MOST_PLACES = 0.06, 40
"""As long as no frame determined the offset, tags may be at places on their path, each further by this (sides of a tag:
half a module), if this many in either direction cover the uncertainty."""
_TRUSTED = 2
"""Number of frames that determined the offset from which on tags that are not where they are expected are not searched
for, once that failed: a clock that jumps puts them elsewhere, blur hides them."""
_MOST_TAGS = 24
"""Tags that are measured in a frame: they determine its pose far better than wheels determine the path to it."""
_A_FACE, _ENOUGH_TAGS = 10, 3
"""Tags of a face that are asked whether they are in view, at most, and how many must be."""
_FASTEST, _MOST_BLUR_PX = 1.0, 6.0
"""Speed in the image up to which frames are looked at, widths a second, as long as none determined the exposure, and
from then on the path of the box during it, px."""
_AGREES = 0.01
"""Corners that lie further off the prediction than this (root mean square, widths of the image) determine no offset."""
_DETERMINED_S = 0.04
"""Predictions are wrong by as much along the path as they may be at all: corners that take longer than this for so much
(root mean square) show that error and nothing of the clock."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedViews:
    """Camera of a robot, and where it is predicted to be between stops.

    Attributes
    ----------
    camera
        Its model.
    T_cam_box_at
        Returns the box's poses (N, 4, 4), m, at times (N,), ns, on the wheels' clock; NaN where none is predicted.
    """

    camera: CameraModel
    T_cam_box_at: Callable[[Ids], Array]

    def tags(self, p_box: Array, t_ns: Ids) -> tuple[Array, Mask]:
        """Return where tags' corners (T, 4, 3) are seen at times (F,), ns, (F, T, 4, 2) px, and which tags face it."""
        T = self.T_cam_box_at(t_ns)
        p_cam = p_box.reshape(-1, 3) @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
        uv = project(self.camera, p_cam.reshape(-1, 3)).reshape(len(t_ns), -1, 4, 2)
        across = uv[:, :, 2] - uv[:, :, 0], uv[:, :, 3] - uv[:, :, 1]
        with np.errstate(invalid="ignore"):
            return uv, across[0][..., 0] * across[1][..., 1] > across[0][..., 1] * across[1][..., 0]


Predictor = Callable[[Correspondences], PredictedViews | None]
"""Predicts views from what was seen at stops; None where the stops do not determine them."""


def _doubled(v: Array) -> Array:
    """Return cosine and sine, (2,), of twice the angle of a direction (2,): how a blur along it is shaped."""
    return np.array([v[0] ** 2 - v[1] ** 2, 2 * v[0] * v[1]]) / max(float(v @ v), 1e-12)


@dataclass(slots=True, kw_only=True, eq=False)
class ClockedViews:
    """Predicted views under the clock offset estimated from the frames found so far.

    Attributes
    ----------
    views, target
        The prediction, and the box.
    image_size : px
        Of the frames.
    told_ns, told_s
        Stamp of each frame that determined an offset, and that offset: its stamp less the time at which it was taken,
        s.
    too_fast
        Speed of the box in the image, widths of the image a second, at which frames showed no tags.
    in_vain
        How many frames were searched for tags that were not where they were expected, and not elsewhere.
    exposures
        Of each frame that determined it, how long the shutter was open, s, and the variance of the blur at rest, px^2.
    """

    views: PredictedViews
    target: Target
    image_size: tuple[int, int]
    told_ns: list[int] = field(default_factory=list)
    told_s: list[float] = field(default_factory=list)
    too_fast: float = np.inf
    in_vain: int = 0
    exposures: list[tuple[float, float]] = field(default_factory=list)
    _motions: dict[int, Array] = field(init=False, default_factory=dict)
    _some: Array = field(init=False)

    def __post_init__(self) -> None:
        """Choose a few tags of each face, their corners (T, 4, 3), m, that are asked whether they are in view."""
        faces = self.target.tag_faces
        rows = [np.flatnonzero(faces == face) for face in np.unique(faces)]
        self._some = self.target.tag_corners[np.concatenate([r[:: -(-len(r) // _A_FACE)] for r in rows])]

    def late_s(self, t_ns: Ids) -> Array:
        """Return the offsets that are allowed for at stamps (F,), (F,) s: those of the nearest frame.

        Clocks drift and jump.
        """
        if not self.told_s:
            return np.zeros(len(t_ns))
        nearest = np.argmin(np.abs(np.subtract.outer(t_ns, np.array(self.told_ns))), axis=1)
        return np.asarray(np.array(self.told_s)[nearest])

    def expected(self, t_ns: int) -> ExpectedTags:
        """Return the tags that a frame stamped ``t_ns`` should show."""
        taken = self._taken_at(t_ns)
        uv, facing = self.views.tags(self.target.tag_corners, np.array([taken]))
        rows = np.flatnonzero(facing[0])
        return ExpectedTags(
            ids=np.array(self.target.tag_ids)[rows],
            corners_px=uv[0, rows],
            blur=self._blur(t_ns),
            alone=len(self.told_s) >= _TRUSTED and self.in_vain > 0,
            most=_MOST_TAGS,
            places_px=self._places(taken, uv[0, rows], rows),
        )

    def _places(self, taken_ns: int, uv: Array, rows: Ids) -> Array:
        """Return where some tags (N,) may be as clocks may differ, close together on their path, (S, N, 4, 2) px.

        ``uv`` is where they are if the clocks do not; nothing if the offset is known, if the box stands still in the
        image, or if there are too many places.
        """
        nowhere = np.zeros((0, len(rows), 4, 2))
        if self.told_s or not len(rows):
            return nowhere
        speed = float(np.linalg.norm(self._motion(taken_ns)))
        apart = _APART * float(np.median(np.linalg.norm(uv - np.roll(uv, 1, axis=1), axis=2)))
        count = np.ceil(_DOUBT_S * speed / apart) if apart > 0 else np.inf
        if not 0 < count <= _MOST_PLACES:
            return nowhere
        late_s = _DOUBT_S / count * np.arange(-count, count + 1)
        places, _ = self.views.tags(self.target.tag_corners[rows], taken_ns - np.rint(1e9 * late_s).astype(np.int64))
        return places

    def _blur(self, t_ns: int) -> Array:
        """Return how a frame stamped ``t_ns`` ought to be blurred, (2,), by its motion and the usual exposure."""
        if not self.exposures:
            return np.zeros(2)
        (exposure_s, at_rest), v = np.median(self.exposures, axis=0), self._motion(self._taken_at(t_ns))
        added = (exposure_s * float(v @ v) ** 0.5) ** 2 / 24
        return np.asarray(added / (added + at_rest) * _doubled(v))

    def readable(self, t_ns: Ids) -> Mask:
        """Return whether frames stamped ``t_ns`` (F,) ought to show tags of the box that can be read.

        As long as no frame determined the offset, whatever it is.
        """
        taken = self._taken(t_ns)
        apart = (0.0,) if self.told_s else (0.0, -_DOUBT_S, _DOUBT_S)
        moments = [taken + round(1e9 * s) for s in (*apart, _STEP_S)]
        uv, facing = self.views.tags(self._some, np.concatenate(moments))
        count, some = len(taken), len(apart) * len(taken)
        in_view = self._in_view(uv[:some], facing[:some]).reshape(len(apart), count).min(axis=0)
        motion = _moved(uv[:count], uv[some:], facing[:count]) / _STEP_S
        self._motions |= zip(taken.tolist(), motion, strict=True)
        speed = np.linalg.norm(motion, axis=1) / self.image_size[0]
        return np.asarray((in_view >= _ENOUGH_TAGS) & (speed <= self._fastest))

    @property
    def _fastest(self) -> float:
        """Speed in the image up to which tags ought to be readable, widths a second."""
        if not self.exposures:
            return min(_FASTEST, self.too_fast)
        exposure_s = float(np.median(self.exposures, axis=0)[0])
        return min(_MOST_BLUR_PX / (exposure_s * self.image_size[0]), self.too_fast)

    def _in_view(self, uv: Array, facing: Mask) -> Ids:
        """Return how many tags at (F, T, 4, 2) px ought to be seen whole, and large enough to be read, (F,)."""
        with np.errstate(invalid="ignore"):
            inside = np.all((uv > 0) & (uv < np.array(self.image_size) - 1), axis=(2, 3))
            side = np.sum((uv - np.roll(uv, 1, axis=2)) ** 2, axis=3).min(axis=2)
            return np.asarray(np.sum(facing & inside & (side > _READABLE_PX**2), axis=1))

    def _motion(self, taken_ns: int) -> Array:
        """Return how the box moves through the image at a time, (2,) px/s: computed once for each."""
        if taken_ns not in self._motions:
            (here, after), (facing, _) = self.views.tags(self._some, taken_ns + np.array([0, round(1e9 * _STEP_S)]))
            self._motions[taken_ns] = _moved(here[None], after[None], facing[None])[0] / _STEP_S
        return self._motions[taken_ns]

    def missed(self, t_ns: int) -> None:
        """Take in that a frame stamped ``t_ns`` showed no tags: others at that speed will not either."""
        self.in_vain += len(self.told_s) >= _TRUSTED
        speed = float(np.linalg.norm(self._motion(self._taken_at(t_ns)))) / self.image_size[0]
        self.too_fast = min(self.too_fast, speed)

    def _taken(self, t_ns: Ids) -> Ids:
        return np.asarray(t_ns - np.rint(1e9 * self.late_s(t_ns)).astype(np.int64))

    def _taken_at(self, t_ns: int) -> int:
        return int(self._taken(np.array([t_ns]))[0])

    def learn(self, t_ns: int, p_box: Array, uv_px: Array, blur: tuple[Array, float]) -> None:
        """Take in landmarks (L, 3) that a frame stamped ``t_ns`` showed at ``uv_px`` (L, 2), and its blur.

        The blur is its shape (2,), and its mean variance, px^2.
        """
        shape, variance = blur
        v = self._motion(self._taken_at(t_ns))
        along = float(shape @ _doubled(v))
        if along > 0:
            self.exposures.append((float(np.sqrt(24 * along * variance / (v @ v))), (1 - along) * variance))
        late_s = float(self.late_s(np.array([t_ns]))[0])
        for _ in range(_ROUNDS):
            here, after = self._seen(t_ns, p_box, np.array([late_s, late_s + _STEP_S]))
            speed = (after - here) / _STEP_S
            square = float(np.sum(speed**2))
            if not square > len(uv_px) * (_AGREES * self.image_size[0] / _DETERMINED_S) ** 2:
                return
            step_s = float(np.sum(speed * (uv_px - here))) / square
            late_s += step_s
            if not abs(late_s) < _LONGEST_S:
                return
            off = here + step_s * speed - uv_px
            if abs(step_s) < _SLIGHT_S:
                break
        if np.sqrt(np.mean(off**2)) < _AGREES * self.image_size[0]:
            self.told_ns.append(t_ns)
            self.told_s.append(late_s)

    def _seen(self, t_ns: int, p_box: Array, late_s: Array) -> Array:
        """Return where landmarks (L, 3) are seen in a frame stamped ``t_ns`` for offsets (K,), s; (K, L, 2) px."""
        T = self.views.T_cam_box_at(t_ns - np.rint(1e9 * late_s).astype(np.int64))
        return np.asarray(project(self.views.camera, p_box @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]))


def _moved(here: Array, after: Array, facing: Mask) -> Array:
    """Return how far tags that face the camera (F, T) move on average from (F, T, 4, 2) to as many places, (F, 2)."""
    count = np.maximum(facing.sum(axis=1), 1)[:, None]
    return np.asarray(np.sum(np.where(facing[..., None], (after - here).mean(axis=2), 0.0), axis=1) / count)
