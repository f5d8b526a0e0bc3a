"""An MCAP file written chunk by chunk, so that whatever happens what was written before stays readable.

A reader needs neither the index nor the end of the file: each chunk stands alone, with the schemas and channels that
its messages are the first to use. Writing is unbuffered; a chunk that cannot be written whole (the disk is full) is cut
off again.

Format: the MCAP specification, https://mcap.dev/spec.
"""

import os
import shutil
import zlib
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel as ChannelRecord,
)
from mcap.records import (
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    MessageIndex,
    Schema,
    Statistics,
)

from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.containers.mcap_records import MAGIC


class ChunkedFile:
    """A new MCAP file; messages are kept until :meth:`flush` writes them as one chunk.

    Parameters
    ----------
    path
        The file to make; it must not be there.

    Raises
    ------
    OSError
        As the file system does.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._file = path.open("xb", buffering=0)
        self._numbers: dict[tuple[str, str, str, bytes], int] = {}
        self._channels: list[Channel] = []
        self._described = 0
        self._pending: list[Message] = []
        self.pending_bytes = 0
        self.messages = 0
        self.size = 0
        self._counts: dict[int, int] = {}
        self._span = (0, 0)
        self._chunks: list[ChunkIndex] = []
        head = RecordBuilder()
        Header(profile="ros2", library="boxcal").write(head)
        self._append(MAGIC + _bytes_of(head))

    @property
    def pending(self) -> int:
        """Messages that are kept for the next chunk."""
        return len(self._pending)

    def add(self, channel: Channel, log_ns: int, data: bytes) -> None:
        """Keep a message for the next chunk."""
        key = (channel.topic, channel.type, channel.encoding, channel.schema)
        number = self._numbers.get(key)
        if number is None:
            self._channels.append(channel)
            number = self._numbers[key] = len(self._channels)
        self._pending.append(Message(channel_id=number, log_time=log_ns, publish_time=log_ns, sequence=0, data=data))
        self.pending_bytes += len(data)

    def flush(self) -> None:
        """Write what is kept as a chunk (OSError if it cannot be; then it is dropped, and the file is as before)."""
        pending, self._pending, self.pending_bytes = self._pending, [], 0
        if not pending:
            return
        described = len(self._channels)
        content, index = self._content(pending)
        times = [m.log_time for m in pending]
        data = lz4.frame.compress(content)
        chunk = RecordBuilder()
        Chunk(
            compression="lz4",
            data=data,
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        ).write(chunk)
        body, offsets, tail = _bytes_of(chunk), {}, RecordBuilder()
        for number, entries in index.items():
            offsets[number] = self.size + len(body) + tail.count
            MessageIndex(channel_id=number, records=entries).write(tail)
        indexes = _bytes_of(tail)
        at = self.size
        self._append(body + indexes)
        self._described = described
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(body),
                chunk_start_offset=at,
                compression="lz4",
                compressed_size=len(data),
                message_end_time=max(times),
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=min(times),
                uncompressed_size=len(content),
            )
        )
        self._counted(pending)

    def close(self) -> None:
        """Write what is kept, the index and the end, and close the file (OSError if that cannot be written)."""
        try:
            self.flush()
            self._append(self._end())
            os.fsync(self._file.fileno())
        finally:
            self._file.close()

    def finished_copy(self, path: Path) -> None:
        """Write all that was flushed so far to another file, finished (OSError if it cannot be)."""
        shutil.copyfile(self.path, path)
        with path.open("ab") as copy:
            copy.write(self._end())

    def _end(self) -> bytes:
        """Return what finishes the file: the end of its data, the index and the footer."""
        end = RecordBuilder()
        DataEnd(data_section_crc=0).write(end)
        body = _bytes_of(end)
        return body + self._summary(self.size + len(body)) + MAGIC

    def _content(self, pending: list[Message]) -> tuple[bytes, dict[int, list[tuple[int, int]]]]:
        """Return a chunk's records and where each message stands among them, by channel."""
        records = RecordBuilder()
        self._describe(records, self._described)
        index: dict[int, list[tuple[int, int]]] = {}
        for message in pending:
            index.setdefault(message.channel_id, []).append((message.log_time, records.count))
            message.write(records)
        return _bytes_of(records), index

    def _describe(self, records: RecordBuilder, first: int) -> None:
        for number, channel in list(enumerate(self._channels, 1))[first:]:
            if channel.type:
                Schema(id=number, name=channel.type, encoding=channel.schema_encoding, data=channel.schema).write(
                    records
                )
            ChannelRecord(
                id=number,
                topic=channel.topic,
                message_encoding=channel.encoding,
                schema_id=number if channel.type else 0,
                metadata={},
            ).write(records)

    def _summary(self, start: int) -> bytes:
        """Return the summary that begins at an offset of the file, and the footer."""
        records = RecordBuilder()
        self._describe(records, 0)
        Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=self.messages,
            message_start_time=self._span[0],
            message_end_time=self._span[1],
            metadata_count=0,
            schema_count=sum(bool(c.type) for c in self._channels),
        ).write(records)
        for chunk in self._chunks:
            chunk.write(records)
        summary = _bytes_of(records)
        head = Opcode.FOOTER.to_bytes(1, "little") + (20).to_bytes(8, "little")
        fields = start.to_bytes(8, "little") + bytes(8)
        footer = RecordBuilder()
        Footer(summary_start=start, summary_offset_start=0, summary_crc=zlib.crc32(summary + head + fields)).write(
            footer
        )
        return summary + _bytes_of(footer)

    def _append(self, data: bytes) -> None:
        """Write bytes at the end, all or none (OSError)."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) or 0 :]
        except OSError:
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise
        self.size += len(data)

    def _counted(self, written: list[Message]) -> None:
        times = [m.log_time for m in written]
        first = min(times) if not self.messages else min(self._span[0], *times)
        self._span = (first, max(self._span[1], *times))
        self.messages += len(written)
        for message in written:
            self._counts[message.channel_id] = self._counts.get(message.channel_id, 0) + 1


def _bytes_of(records: RecordBuilder) -> bytes:
    """Return what was built, and begin anew."""
    return bytes(records.end())  # type: ignore[no-untyped-call]
