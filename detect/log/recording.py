"""A robot's log: wheel samples as arrays, camera frames lazily by time.

Header stamps are the time base: they say when a sample was taken. Log times say when a message arrived, late by an
unknown delay, and are used for nothing. The first pass (:mod:`boxcal.detect.log.scan`) reads all joints and the stamps
of all
images; images are decoded one at a time when they are asked for, from the places that the first pass noted. So a log
needs no index, and memory does not grow with its images.
"""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey, bits_of, eight_bits, full_scale
from boxcal.detect.log.encoder import clean, join, span
from boxcal.detect.log.mcap_records import Message, read_messages, walk
from boxcal.detect.log.messages import DECODERS, Grey, header_stamp_ns
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.scan import Scan
from boxcal.detect.log.topics import Joint, Topics, choose_camera, choose_wheels
from boxcal.detect.log.wheel_samples import WheelSamples, WheelUnits
from boxcal.target.arrays import Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """One log, opened.

    Attributes
    ----------
    path
        The file.
    camera_topic, camera_kind
        Where the images are and their message type.
    left, right
        Topic and joint of each wheel.
    wheels
        All wheel samples.
    frame_t_ns : (F,) ns
        Header stamps of the images, strictly ascending.
    frame_places : (F, 2)
        Where each image's message stands in the file: record and offset within its chunk (-1 if in none).
    """

    path: Path
    camera_topic: str
    camera_kind: str
    left: Joint
    right: Joint
    wheels: WheelSamples
    frame_t_ns: Ids
    frame_places: Ids

    def frames_between(self, t_start_ns: int, t_end_ns: int) -> Ids:
        """Return the indices of the frames within a time window, both ends included."""
        first = np.searchsorted(self.frame_t_ns, t_start_ns, side="left")
        last = np.searchsorted(self.frame_t_ns, t_end_ns, side="right")
        return np.arange(first, last, dtype=np.int64)

    def used_bits(self, indices: Iterable[int]) -> int:
        """Return how many bits the camera's grey levels have: 8, 10, 12, 14 or 16.

        A message says how wide its numbers are, not how many of their bits the sensor fills; that is told from the
        largest value in some frames. Errors as for :meth:`read_frames`.
        """
        return max((bits_of(image) for _, image in self._decoded(indices)), default=8)

    def read_frames(self, indices: Iterable[int]) -> Iterator[tuple[int, Grey]]:
        """Decode frames one at a time, in 8 bits: pictures to look at, deeper ones each at the bits it has.

        Parameters
        ----------
        indices
            Rows of ``frame_t_ns``; ascending is fastest.

        Yields
        ------
        Header stamp (ns) and grey image (H, W).

        Raises
        ------
        DetectError
            If the file changed since it was opened or an image does not decode (its stamp is named).
        """
        for t_ns, image in self._decoded(indices):
            yield t_ns, eight_bits(full_scale(image, 8))

    def read_deep_frames(self, indices: Iterable[int], bits: int) -> Iterator[tuple[int, DeepGrey]]:
        """Decode frames one at a time, with all the bits they have: what corners are measured in.

        As :meth:`read_frames`, but images of more than 8 bits stay uint16, with white at 65535.

        Parameters
        ----------
        indices
            Rows of ``frame_t_ns``; ascending is fastest.
        bits
            Of the camera's grey levels (:meth:`used_bits`); a frame with values beyond is taken to have more.
        """
        for t_ns, image in self._decoded(indices):
            yield t_ns, full_scale(image, bits)

    def _decoded(self, indices: Iterable[int]) -> Iterator[tuple[int, DeepGrey]]:
        name, decode = self.path.name, DECODERS[self.camera_kind]
        held, messages = -1, dict[int, Message]()
        try:
            with self.path.open("rb") as file:
                for index in indices:
                    record, inner = (int(v) for v in self.frame_places[index])
                    t_ns = int(self.frame_t_ns[index])
                    if record != held:
                        held, messages = record, read_messages(file, name, record)
                    message = messages.get(inner)
                    if message is None or header_stamp_ns(message.data) != t_ns:
                        raise DetectError(f"{name}: changed while it was read; close its recorder and try again")
                    try:
                        image = decode(message.data)
                    except DetectError as error:
                        where = f"image of {t_ns / 1e9:.3f} s in {printable(self.camera_topic)}"
                        raise DetectError(f"{name}: {where}: {error}") from error
                    yield t_ns, image
        except OSError as error:
            raise DetectError(f"{name}: cannot be read ({error.strerror or error}); check the disk") from error


def open_recording(path: Path, topics: Topics | None = None, units: WheelUnits | None = None) -> Recording:
    """Read a ROS 2 log in MCAP: all joints, and where the images are.

    Parameters
    ----------
    path
        The log.
    topics
        Names where the log is ambiguous.
    units
        What the wheel readings mean; rad, rolling forward, if None.

    Raises
    ------
    DetectError
        If the file cannot be read, or lacks camera, wheels, messages or a common time; the message says what to do.
    """
    name = path.name
    scan = Scan(name=name, topics=topics or Topics())
    try:
        if path.is_dir():
            raise DetectError(f"{name}: is a folder, one .mcap file is needed; name the file inside it")
        with path.open("rb") as file:
            for record in walk(file, name):
                scan.take(record)
    except FileNotFoundError as error:
        raise DetectError(f"{name}: no such file, a log in MCAP is needed; check the path") from error
    except OSError as error:
        raise DetectError(f"{name}: cannot be read ({error.strerror or error}); check the file") from error
    return _assembled(scan, path, units or WheelUnits())


def file_sha256(path: Path) -> str:
    """Return a file's SHA-256, hexadecimal (DetectError if it cannot be read)."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DetectError(f"{path.name}: cannot be read ({error.strerror or error}); check the path") from error


def _assembled(scan: Scan, path: Path, units: WheelUnits) -> Recording:
    scan.refuse_other_worlds()
    name, types = scan.name, scan.types()
    camera = choose_camera(name, scan.image_counts(), types, scan.topics.camera_topic)
    left, right = choose_wheels(name, scan.joints, types, scan.topics)
    encoders = []
    for (topic, joint), factor in zip((right, left), units.factors, strict=True):
        series = scan.joints[topic][joint]
        who = f"{name}: joint {printable(joint)} in {printable(topic)}"
        if not series.t_ns:
            raise DetectError(f"{who}: no positions, wheel angles in rad are needed; make the driver publish them")
        encoders.append(clean(np.array(series.t_ns, dtype=np.int64), factor * np.array(series.value), who))
    wheels = join(encoders[0], encoders[1], name)
    kind, images = scan.images_of(camera)
    t_ns, first = np.unique(np.array(images.t_ns, dtype=np.int64), return_index=True)
    if max(t_ns[0], wheels.t_ns[0]) > min(t_ns[-1], wheels.t_ns[-1]):
        raise DetectError(
            f"{name}: images are stamped {span(t_ns)} and wheels {span(wheels.t_ns)}, times that overlap are needed; "
            "stamp both with one clock"
        )
    places = np.stack([np.array(images.record, dtype=np.int64), np.array(images.inner, dtype=np.int64)], axis=1)
    return Recording(
        path=path,
        camera_topic=camera,
        camera_kind=kind,
        left=left,
        right=right,
        wheels=wheels,
        frame_t_ns=t_ns,
        frame_places=places[first],
    )
