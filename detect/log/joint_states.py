"""Many ``sensor_msgs/JointState`` messages as arrays: equal layouts are read together, by numpy."""

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Batch
from boxcal.target.arrays import Array, Ids

MAX_JOINTS = 10_000
MAX_JOINT_NAME = 256
"""Longest name of a joint, bytes."""
_NS = 1_000_000_000
_MANY_LAYOUTS = 16
"""After so many layouts in one batch its messages are read one by one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLayout:
    """Layout of the numbers in a joint message.

    Attributes
    ----------
    names
        Joints in the message.
    stamp_at, positions_at, velocities_at
        Offsets of the stamp's two words and of the first position and velocity; -1 where there are none.
    order
        ``<`` or ``>``, the byte order.
    signed
        Whether the stamp's seconds are signed (ROS 2).
    """

    names: tuple[str, ...]
    stamp_at: int
    positions_at: int
    velocities_at: int
    order: str
    signed: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointBlock:
    """Messages of one layout.

    Attributes
    ----------
    names
        Joints.
    t_ns : (N,) ns
        Header stamps.
    log_ns : (N,) ns
        When they were recorded.
    positions, velocities : (N, J) or None
        Numbers by joint, None where the messages carry none.
    """

    names: tuple[str, ...]
    t_ns: Ids
    log_ns: Ids
    positions: Array | None
    velocities: Array | None


class JointReader:
    """Reads the joint messages of one channel; knows the layouts that it has seen."""

    def __init__(self, *, ros1: bool) -> None:
        self._ros1 = ros1
        self._layout: JointLayout | None = None
        self._template = np.zeros(0, dtype=np.uint8)
        self._fixed = np.zeros(0, dtype=np.bool_)
        self.damaged = 0
        self.problem = ""

    def blocks(self, batch: Batch) -> list[JointBlock]:
        """Return the messages of a batch, those of one layout together; damaged ones are counted and left out."""
        starts, ends, log = batch.starts, batch.ends, batch.log_ns
        memory = np.frombuffer(batch.data, dtype=np.uint8)
        out: list[JointBlock] = []
        lengths = ends - starts
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            out += self._alike(batch.data, memory, starts[rows], int(length), log[rows])
        return out

    def _alike(
        self, data: bytes | memoryview, memory: NDArray[np.uint8], starts: Ids, length: int, log: Ids
    ) -> list[JointBlock]:
        """Return messages of one length, those of one layout together."""
        out: list[JointBlock] = []
        left = np.arange(starts.size)
        rounds = 0
        while left.size:
            one_by_one = rounds > _MANY_LAYOUTS  # layouts change all the time
            rounds += 1
            first = int(starts[left[0]])
            rows = left[:1] if one_by_one else left
            try:
                self._learn_if_new(bytes(data[first : first + length]))
            except DetectError as error:
                self.damaged += 1
                self.problem = str(error)
                left = left[1:]
                continue
            many = memory[starts[rows][:, None] + np.arange(length)]
            same = np.all(many[:, self._fixed] == self._template[self._fixed], axis=1)
            out.append(self._block(many[same], log[rows[same]]))
            left = left[1:] if one_by_one else left[~same]
        return out

    def _learn_if_new(self, data: bytes) -> None:
        """Learn a message's layout unless it is that of the last (DetectError if it is no joint message)."""
        row = np.frombuffer(data, dtype=np.uint8)
        if (
            self._layout is not None
            and row.size == self._template.size
            and np.array_equal(row[self._fixed], self._template[self._fixed])
        ):
            return
        layout = joint_layout(data, ros1=self._ros1)
        fixed = np.ones(row.size, dtype=np.bool_)
        fixed[layout.stamp_at : layout.stamp_at + 8] = False
        if self._ros1:
            fixed[:4] = False  # sequence number
        count = 8 * len(layout.names)
        for at in (layout.positions_at, layout.velocities_at):
            if at >= 0:
                fixed[at : at + count] = False
        if layout.velocities_at >= 0:  # efforts, which are not looked at
            fixed[layout.velocities_at + count :] = False
        self._layout, self._fixed, self._template = layout, fixed, row

    def _block(self, many: NDArray[np.uint8], log: Ids) -> JointBlock:
        layout = self._layout
        if layout is None:
            raise AssertionError("a layout is learnt before it is used")
        words = np.ascontiguousarray(many[:, layout.stamp_at : layout.stamp_at + 8])
        sec = words[:, :4].copy().view(f"{layout.order}{'i' if layout.signed else 'u'}4")[:, 0].astype(np.int64)
        nanosec = words[:, 4:].copy().view(f"{layout.order}u4")[:, 0].astype(np.int64)

        def numbers(at: int) -> Array | None:
            if at < 0:
                return None
            return (
                np.ascontiguousarray(many[:, at : at + 8 * len(layout.names)]).view(f"{layout.order}f8").astype(float)
            )

        return JointBlock(
            names=layout.names,
            t_ns=sec * _NS + nanosec,
            log_ns=log,
            positions=numbers(layout.positions_at),
            velocities=numbers(layout.velocities_at),
        )


def joint_layout(data: bytes, *, ros1: bool) -> JointLayout:
    """Return where the numbers stand in a joint message.

    CDR aligns numbers to their size, counted from behind the four bytes of encapsulation; ROS 1 does not.

    Raises
    ------
    DetectError
        If the bytes are no such message, or names and numbers differ in number.
    """
    base = 0 if ros1 else 4
    if not ros1 and (len(data) < 12 or data[0] != 0 or data[1] not in {0, 1}):
        raise DetectError("a message is not plain CDR; record with a ROS 2 whose middleware writes CDR")
    order = "<" if ros1 or data[1] else ">"

    def aligned(at: int, size: int) -> int:
        return at if ros1 else base + -(-(at - base) // size) * size

    def count(at: int) -> tuple[int, int]:
        at = aligned(at, 4)
        return int(struct.unpack_from(f"{order}I", data, at)[0]), at + 4

    try:
        stamp_at = base + (4 if ros1 else 0)
        length, at = count(stamp_at + 8)
        at += length
        names, at = count(at)
        if names > MAX_JOINTS:
            raise DetectError(f"a joint message names {names} joints, at most {MAX_JOINTS} are read")
        found: list[str] = []
        for _ in range(names):
            length, at = count(at)
            if length > MAX_JOINT_NAME or at + length > len(data):
                raise DetectError(f"a joint's name of {length} bytes; the log is damaged")
            found.append(data[at : at + length].decode().rstrip("\0"))
            at += length
        places = []
        for what in ("positions", "velocities"):
            numbers, at = count(at)
            if what == "positions" and numbers not in {0, names}:
                raise DetectError(
                    f"a joint message has {names} names and {numbers} {what}, one position a name is needed; check the "
                    "driver that publishes it"
                )
            at = aligned(at, 8) if numbers else at
            places.append(at if numbers == names and names else -1)
            at += 8 * numbers
        if at > len(data):
            raise DetectError(f"a joint message of {len(data)} bytes is cut short; the log is damaged")
    except (struct.error, UnicodeDecodeError) as error:
        raise DetectError(
            f"a message does not decode as sensor_msgs/msg/JointState ({error}); the log or its schema is damaged"
        ) from error
    return JointLayout(
        names=tuple(found),
        stamp_at=stamp_at,
        positions_at=places[0],
        velocities_at=places[1],
        order=order,
        signed=not ros1,
    )
