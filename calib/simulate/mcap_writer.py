"""Ordinary ROS 2 logs: MCAP files with joint states and camera images."""

import secrets
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from boxcal.calib.errors import CalibError

COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
"""Chunk compressions by name."""

JOINTS = "sensor_msgs/msg/JointState"
_BYTES_A_PIXEL = {"mono8": 1, "8UC1": 1, "bgr8": 3, "rgb8": 3, "8UC3": 3, "bgra8": 4, "rgba8": 4}
_NS = 1_000_000_000


class LogWriter:
    """An MCAP file that ``ros2 bag record`` could have written, as a context manager.

    Messages stand in the file in the order of the calls; give them by ascending log time, as a recorder does. The
    same calls give the same bytes. The file appears under its name, whole, when the block ends without an exception;
    until then, and for ever after an exception, what stood there stays.

    Parameters
    ----------
    path
        Where the log goes; its folder is made if it is missing.
    compression
        Of the chunks: ``none``, ``lz4`` or ``zstd``.
    chunk_bytes
        Size at which a chunk is closed.

    Raises
    ------
    CalibError
        If the compression has none of these names.
    OSError
        As the file system does.
    """

    def __init__(self, path: Path, *, compression: str = "zstd", chunk_bytes: int = 1 << 20) -> None:
        if compression not in COMPRESSIONS:
            raise CalibError(
                f"compression {compression!r}, one of {', '.join(COMPRESSIONS)} is needed",
                source=path.name,
                remedy="choose one",
            )
        self._path = path
        self._part = path.parent / f".{path.name[:40]}.{secrets.token_hex(4)}.part"
        self._compression = COMPRESSIONS[compression]
        self._chunk_bytes = chunk_bytes
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}

    def __enter__(self) -> Self:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file: IO[bytes] = self._part.open("xb")
        self._writer: Any = Writer(self._file, chunk_size=self._chunk_bytes, compression=self._compression)
        self._writer.start(profile="ros2", library="boxcal")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._writer.finish()
            self._file.close()
            if kind is None:
                self._part.replace(self._path)
        finally:
            self._file.close()
            self._part.unlink(missing_ok=True)

    def joint_state(  # noqa: PLR0917  the message's fields in their order
        self,
        topic: str,
        stamp_ns: int,
        log_ns: int,
        names: Sequence[str],
        positions: Sequence[float] | NDArray[np.float64],
        velocities: Sequence[float] | NDArray[np.float64] = (),
        *,
        frame_id: str = "",
    ) -> None:
        """Write a ``sensor_msgs/msg/JointState``: angles in rad, speeds in rad/s."""
        self.message(
            topic,
            log_ns,
            self._new(
                JOINTS,
                header=self._header(stamp_ns, frame_id),
                name=list(names),
                position=np.asarray(positions, dtype=np.float64),
                velocity=np.asarray(velocities, dtype=np.float64),
                effort=np.zeros(0),
            ),
        )

    def compressed_image(
        self,
        topic: str,
        stamp_ns: int,
        log_ns: int,
        data: bytes,
        format: str = "jpeg",  # noqa: A002  the field's name in the message
        *,
        frame_id: str = "camera",
    ) -> None:
        """Write a ``sensor_msgs/msg/CompressedImage`` that holds an encoded image."""
        self.message(
            topic,
            log_ns,
            self._new(
                "sensor_msgs/msg/CompressedImage",
                header=self._header(stamp_ns, frame_id),
                format=format,
                data=np.frombuffer(data, dtype=np.uint8),
            ),
        )

    def image(
        self,
        topic: str,
        stamp_ns: int,
        log_ns: int,
        array: NDArray[np.uint8],
        encoding: str = "mono8",
        *,
        frame_id: str = "camera",
    ) -> None:
        """Write a ``sensor_msgs/msg/Image`` of 8 bits a channel, (H, W) or (H, W, channels)."""
        channels = 1 if array.ndim == 2 else array.shape[2]
        if _BYTES_A_PIXEL.get(encoding) != channels or array.dtype != np.uint8:
            raise CalibError(
                f"an image of {channels} {array.dtype} channels as {encoding!r}: 8-bit channels that fit the encoding "
                f"are needed",
                remedy=f"known encodings: {', '.join(_BYTES_A_PIXEL)}",
            )
        self.message(
            topic,
            log_ns,
            self._new(
                "sensor_msgs/msg/Image",
                header=self._header(stamp_ns, frame_id),
                height=array.shape[0],
                width=array.shape[1],
                encoding=encoding,
                is_bigendian=0,
                step=array.shape[1] * channels,
                data=np.ascontiguousarray(array).reshape(-1),
            ),
        )

    def message(self, topic: str, log_ns: int, message: Any) -> None:
        """Write any message of rosbags' ROS 2 Humble types; its ``__msgtype__`` names the schema."""
        kind = message.__msgtype__
        self.raw(topic, kind, log_ns, bytes(self._store.serialize_cdr(message, kind)))

    def raw(self, topic: str, kind: str, log_ns: int, data: bytes) -> None:
        """Write bytes as a CDR message of a kind, such as ``sensor_msgs/msg/Image``, whatever they hold."""
        if kind not in self._schemas:
            if kind not in self._store.fielddefs:
                raise CalibError(f"message kind {kind!r}: one of ROS 2 Humble's is needed, such as {JOINTS}")
            definition = self._store.generate_msgdef(kind, ros_version=2)[0]
            self._schemas[kind] = self._writer.register_schema(name=kind, encoding="ros2msg", data=definition.encode())
        if (topic, kind) not in self._channels:
            self._channels[topic, kind] = self._writer.register_channel(
                topic=topic, message_encoding="cdr", schema_id=self._schemas[kind]
            )
        self._writer.add_message(self._channels[topic, kind], log_time=log_ns, publish_time=log_ns, data=data)

    def _new(self, kind: str, **content: Any) -> Any:
        return self._store.types[kind](**content)

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        sec, nanosec = divmod(int(stamp_ns), _NS)
        stamp = self._new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self._new("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)
