"""The box looked for at the stops of a recording, and what explains that it is not found."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from boxcal.detect.alignment.detection import KnownCamera
from boxcal.detect.alignment.expected_tags import ExpectedTags
from boxcal.detect.image.bit_depth import DeepGrey, eight_bits
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.safe_text import counted, listed, printable
from boxcal.detect.log.topics import distances
from boxcal.detect.stops import MIN_STOPS, Stop, StopSettings
from boxcal.detect.tags.averaging import AveragedCorners
from boxcal.detect.tags.built_box import built_box
from boxcal.detect.tags.detections import TagSettings, find_tags, other_family
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.detect.tags.on_the_move import (
    MOST_WITHOUT_STOPS,
    TRIED,
    BoxOnTheMove,
    Choice,
    budget,
    candidates,
    may_be_measured,
    single_frame,
    spread_frames,
)
from boxcal.detect.tags.predicted_views import ClockedViews, PredictedViews
from boxcal.detect.tags.print_size import print_scale
from boxcal.detect.tags.stop_measurement import MeanPicture, StopMeasurement, measure_picture, measure_stop
from boxcal.target.arrays import Ids
from boxcal.target.box import Target

MANY_REJECTED = 0.1
"""Tags rejected for each tag of the box from which on the box is not as described, or there are two."""
MOST_KEPT_BYTES = 1 << 25
"""Images of stops that are kept, for the case that the box is not as described; the others are read again."""
_MOST_WITHOUT_BOX = 24
"""After so many frames of a robot that stood still at too few places, all without the box, no more are looked at."""
MOST_PIXELS = 3_000_000_000
"""Pixels that are looked at in one recording; beyond it one frame a stop must do."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownBox:
    """A box and a camera as stops showed them.

    Attributes
    ----------
    target, camera
        The box, and the camera to begin with.
    expected
        Tags that each stop, by number, should show.
    pictures
        Mean images of stops, by number.
    odd_sizes
        Frames of another size than the first, which were left out.
    """

    target: Target
    camera: KnownCamera
    expected: Mapping[int, ExpectedTags]
    pictures: Mapping[int, MeanPicture]
    odd_sizes: int


class BoxAtStops:
    """Looks at stops, and remembers what explains a failure.

    Attributes
    ----------
    image_size : px
        Width and height of the camera's images.
    frames, with_frames, with_tags
        Frames that were looked at; stops with frames, and with tags of the box.
    moved
        Stops of which frames were left out since the image moved, or whose frames hardly show one image.
    unsettled
        The latter of them.
    odd_sizes
        Frames of another size than the first, which were left out.
    tags
        Tags of the box that were found, over all stops.
    rejected
        Tags that were read at each stop but do not lie where the box has them; none at most.
    last_frame
        The last one that was looked at; None before that, and where its stop's mean was kept.
    print_sizes : (FACES,)
        Sizes of the faces' prints over that of most, as far as they differ; empty if they do not.
    """

    def __init__(  # noqa: PLR0917
        self,
        recording: Recording,
        target: Target,
        tags: TagSettings,
        bits: int,
        size: tuple[int, int],
        known: KnownBox | None = None,
    ) -> None:
        self._recording, self._target, self._tags, self._bits = recording, target, tags, bits
        self.frames = self.with_frames = self.with_tags = self.moved = self.odd_sizes = 0
        self.tags = self.unsettled = 0
        self.rejected: list[int] = []
        self._contradicting: tuple[int, DeepGrey] | None = None
        self._foreign: set[int] = set()
        self.last_frame: DeepGrey | None = None
        self.print_sizes: tuple[float, ...] = ()
        self._known, self._camera = known, None if known is None else known.camera
        self._pixels = 0
        self._pictures: dict[int, MeanPicture] = {}
        self._kept_bytes = 0
        self.odd_sizes += 0 if known is None else known.odd_sizes
        self.image_size = size

    def at(self, frames: Ids, number: int) -> tuple[AveragedCorners, str]:
        """Return what the frames of a stop (from 0) show, and which of them were left out and why."""
        found = self._measured(frames, number)
        self._camera = found.camera
        self._foreign.update(found.foreign_ids.tolist())
        self.with_frames += bool(found.corners.frames)
        self.with_tags += found.corners.tags > 0
        self.tags += found.corners.tags
        self._take_rejected(len(found.rejected_ids))
        self.unsettled += not found.settled
        self.moved += "moved" in found.left_out or not found.settled
        return found.corners, found.left_out

    def _measured(self, frames: Ids, number: int) -> StopMeasurement:
        """Return what the frames of a stop show: in their mean as it was kept, where it was."""
        known = self._known
        picture = None if known is None else known.pictures.get(number)
        if known is not None and picture is not None:
            self.last_frame = None
            self.frames += picture.frames
            return measure_picture(picture, self._target, self._tags, self._camera, known.expected.get(number))
        if self._pixels > MOST_PIXELS:
            frames = frames[frames.size // 2 :][:1]
        found = measure_stop(self._images(frames), self._target, self._tags, self._camera)
        if known is None and found.picture is not None:
            self._kept_bytes += found.picture.mean.nbytes
            if self._kept_bytes <= MOST_KEPT_BYTES:
                self._pictures[number] = replace(found.picture, example=None)
        return found

    def _take_rejected(self, count: int) -> None:
        """Remember how many tags of a stop were rejected, and the image with the most of them."""
        self.rejected.append(count)
        if self.last_frame is not None and count > (0 if self._contradicting is None else self._contradicting[0]):
            self._contradicting = (count, self.last_frame)

    def between(
        self, stops: Sequence[Stop], stands: Sequence[Stop], target: Target, views: PredictedViews | None = None
    ) -> tuple[MovingFrame, ...]:
        """Return frames taken between stops that show the box, a few that are informative (see ``on_the_move``).

        Parameters
        ----------
        stops, stands
            Stops at which the box was seen, and all stands.
        target
            The box to look for.
        views
            What the stops predict, if anything.
        """
        if self._camera is None or not may_be_measured(self._tags, self.image_size) or len(stops) < MIN_STOPS:
            return ()
        recording = self._recording
        among = candidates(recording.wheels, stops, stands, recording.frame_t_ns)
        choice, clocked = Choice(among=among), None
        if views is not None:
            stamps = recording.frame_t_ns[among.frames]
            clocked = ClockedViews(views=views, target=target, image_size=self.image_size)
            choice = Choice(among=among, in_view=lambda rows: clocked.readable(stamps[rows]))
        look, wanted = BoxOnTheMove(target, self._tags, self._camera, clocked), budget(len(stops) - 1)
        found: list[MovingFrame] = []
        for _ in range(round(TRIED * wanted)):
            at = choice.next()
            if at is None or len(found) == wanted or self._pixels > MOST_PIXELS:
                break
            row = int(choice.among.frames[at])
            seen = [
                look.at(image, t_ns)
                for t_ns, image in recording.read_deep_frames([row], self._bits)
                if (image.shape[1], image.shape[0]) == self.image_size
            ]
            self._pixels += self.image_size[0] * self.image_size[1]
            shown = [frame for frame in seen if frame is not None]
            choice.learn(at, shown=bool(shown))
            found += shown
        return tuple(sorted(found, key=lambda frame: frame.t_ns))

    def on_the_move(self) -> tuple[MovingFrame, ...]:
        """Return frames of a robot that stood still at too few places which show the box, spread over its drive."""
        if not may_be_measured(self._tags, self.image_size):
            return ()
        recording = self._recording
        found: list[MovingFrame] = []
        rows = spread_frames(recording.wheels, recording.frame_t_ns)[: round(TRIED * MOST_WITHOUT_STOPS)]
        for looked_at, row in enumerate(rows.tolist()):
            never_shown = looked_at >= _MOST_WITHOUT_BOX and not found
            if never_shown or len(found) == MOST_WITHOUT_STOPS or self._pixels > MOST_PIXELS:
                break
            seen = measure_stop(self._images(np.array([row])), self._target, self._tags, self._camera)
            self._camera = seen.camera
            frame = single_frame(int(recording.frame_t_ns[row]), seen.corners, self._target)
            found += [] if frame is None else [frame]
        return tuple(sorted(found, key=lambda frame: frame.t_ns))

    def print_scale(self) -> float:
        """Return the size of the prints against their description if that explains rejected tags, else 1."""
        if self._contradicting is None or sum(self.rejected) < MANY_REJECTED * self.tags:
            return 1.0
        return print_scale(self._contradicting[1], self._target, self._tags)

    def built_box(self, seen: Mapping[int, AveragedCorners]) -> KnownBox | None:
        """Return the box as what stops (by number) show it, if it is not as it was looked for, else None."""
        if self._camera is None:
            return None
        stops = {number: (corners.landmark_ids, corners.uv_px) for number, corners in seen.items()}
        built = built_box(self._target, list(stops.values()), self.image_size, self._camera.prior)
        if built is None:
            return None
        expected = {number: built.expected(*stop, self.image_size) for number, stop in stops.items()}
        return KnownBox(
            target=built.target,
            camera=replace(self._camera, prior=built.camera),
            expected=expected,
            pictures=self._pictures,
            odd_sizes=self.odd_sizes,
        )

    def _images(self, frames: Ids) -> Iterator[DeepGrey]:
        for _, image in self._recording.read_deep_frames(frames, self._bits):
            if (image.shape[1], image.shape[0]) != self.image_size:
                self.odd_sizes += 1
                continue
            self._pixels += image.size
            self.frames += 1
            self.last_frame = image
            yield image

    def notes(self) -> tuple[str, ...]:
        """Return what a user should know of the frames."""
        missing, why = self._recording.frames_missing()
        out = []
        if missing:
            out.append(f"{missing} image{'s' if missing > 1 else ''} of {self.frames + missing} left out ({why})")
        rejected, stops = sum(self.rejected), sum(count > 0 for count in self.rejected)
        if rejected:
            out.append(
                f"{rejected} tag{'s' if rejected > 1 else ''} at {stops} stop{'s' if stops > 1 else ''} "
                f"{'were' if rejected > 1 else 'was'} read but not where the box has such a tag, and left out "
                f"(beside {self.tags} that do)"
            )
        if self.unsettled:
            out.append(
                f"the frames of {self.unsettled} stop{'s' if self.unsettled > 1 else ''} do not show one still "
                "picture: their mean is used, with their scatter as its uncertainty"
            )
        if self.odd_sizes:
            out.append(f"{self.odd_sizes} images of another size than {_size(self.image_size)} px were left out")
        return tuple(out)

    def why_not(self, stops: int, usable: int, settings: StopSettings, min_tags: int) -> str:
        """Return why fewer than three stops are usable, and what to do."""
        missing, why = self._recording.frames_missing()
        lost = "".join(f"; {note}" for note in (*self._recording.notes, *self.notes()))
        if missing and not self.frames:
            where = printable(self._recording.camera_topic)
            return f"none of the {missing} images looked at in {where} decodes: {why}"
        if stops >= MIN_STOPS and self.frames == 0:
            return (
                f"{counted(stops, 'stop')} but no image was taken during any of them, images while the robot stands "
                f"are needed; record the camera all the time, stamped with the wheels' clock{lost}"
            )
        if self.frames and not self.with_tags:
            seen = f"{counted(self.frames, 'image')} looked at at {counted(self.with_frames, 'stop')}"
            return f"no tag of the box in the {seen}{self._hint()}{lost}"
        return (
            f"{counted(stops, 'stop')} of {settings.min_stand:g} s or longer, {self.with_frames} of them with "
            f"images, {self.with_tags} with the box, {usable} with {min_tags} tags or more; "
            f"{MIN_STOPS} such stops are needed; let the robot stand still for two seconds in more places "
            f"where it sees the box{lost}"
        )

    def _hint(self) -> str:
        box = self._target.box
        ids = self._target.tag_ids
        if self.last_frame is not None and self._mirrored(self.last_frame):
            return (
                ", but there are in their mirror images: the pictures are mirrored (or the sheets were printed so); "
                "turn off the mirroring (flip) of the camera's driver"
            )
        if self._foreign:
            return (
                f": tags {listed(map(str, sorted(self._foreign)))} of {box.dictionary} were seen, the target carries "
                f"{ids[0]} to {ids[-1]}; give the target.json that this box was printed from"
            )
        example = None if self.last_frame is None else eight_bits(self.last_frame)
        other = None if example is None else other_family(example, box.dictionary, self._tags)
        if other is not None:
            return (
                f": tags of {other} were seen, the target carries {box.dictionary}; give the target.json that this box "
                "was printed from"
            )
        where = printable(self._recording.camera_topic)
        if distances(self._recording.camera_topic):
            return f" of {where}, which by its name holds distances, no pictures; name a camera's topic"
        return f" of {where}; check that the camera sees the box, in focus and lit, and that this is its target.json"

    def _mirrored(self, image: DeepGrey) -> bool:
        found = find_tags(np.ascontiguousarray(cv2.flip(image, 1)), self._target, self._tags)
        return len(found.ids) > 1


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"
