"""Compressed files and chunks unpacked within bounds."""

import bz2
import gzip
import hashlib
import tempfile
import zlib
from pathlib import Path
from typing import IO, BinaryIO, cast

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import MAX_RECORD_BYTES, Budget
from boxcal.detect.log.safe_text import printable

ERRORS = (ValueError, EOFError, RuntimeError, OSError, zlib.error, zstandard.ZstdError, MemoryError)
"""What the unpackers raise on damaged input."""
_MAX_WINDOW = 1 << 27
_BLOCK = 1 << 20
SUFFIXES = (".zst", ".zstd", ".gz")
"""File names that say a whole recording is compressed."""


def unpacked(data: bytes | memoryview, compression: str, size: int) -> bytes | memoryview:
    """Return a chunk's content, which must have the size that the chunk claims.

    Raises
    ------
    DetectError
        If the size is unreasonable or not as claimed, or the compression is not known.
    """
    if size > MAX_RECORD_BYTES:
        raise DetectError(f"its chunk claims to unpack to {size} bytes, at most {MAX_RECORD_BYTES} are read")
    if compression == "":
        content: bytes | memoryview = data
    elif size == 0:
        content = b""
    elif compression == "zstd":
        content = _zstd(data, size)
    elif compression == "lz4":
        content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif compression == "bz2":
        content = bz2.BZ2Decompressor().decompress(data, max_length=size + 1)
    else:
        raise DetectError(f"its chunk is compressed with {printable(compression)!r}, zstd and lz4 are read")
    if len(content) != size:
        found = f"more than {size}" if len(content) > size else f"{len(content)}"
        raise DetectError(f"its chunk claims to unpack to {size} bytes and unpacks to {found}")
    return content


def _zstd(data: bytes | memoryview, size: int) -> bytes:
    """Return what Zstandard data unpack to, at most one byte more than was claimed."""
    head = zstandard.get_frame_parameters(bytes(data[:32]))
    if head.content_size == size and head.window_size <= _MAX_WINDOW:  # at once, where the frame agrees
        return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    stream = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW).stream_reader(data, read_across_frames=True)
    return stream.read(size + 1)


def unpacked_beginning(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """Return what the intact beginning of a chunk that was cut off unpacks to."""
    size = min(size, MAX_RECORD_BYTES)
    parts: list[bytes] = []
    try:
        if compression == "":
            return bytes(data[:size])
        if compression == "zstd":
            worker = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW).decompressobj()
        elif compression == "lz4":
            worker = lz4.frame.LZ4FrameDecompressor()
        else:
            return b""
        total = 0
        for at in range(0, len(data), 1 << 14):
            part = worker.decompress(bytes(data[at : at + (1 << 14)]))
            parts.append(part)
            total += len(part)
            if total > size:
                break
    except ERRORS:  # what came before the damage is intact
        pass
    return b"".join(parts)[:size]


def message_unpacked(data: bytes | memoryview) -> bytes:
    """Return one message that was compressed by itself with zstd (DetectError if it does not unpack)."""
    try:
        reader = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW).stream_reader(data)
        content = reader.read(MAX_RECORD_BYTES + 1)
    except ERRORS as error:
        raise DetectError(f"a compressed message does not unpack ({printable(str(error))})") from error
    if len(content) > MAX_RECORD_BYTES:
        raise DetectError(f"a compressed message unpacks to more than {MAX_RECORD_BYTES} bytes")
    return content


def unpacked_file(path: Path) -> tuple[BinaryIO, str, bool]:
    """Return a temporary file with what a compressed file holds, the SHA-256 of the compressed one, and if it is whole.

    Raises
    ------
    DetectError
        If nothing of it unpacks, or it unpacks to far more than a recording does.
    """
    digest, whole = hashlib.sha256(), True
    budget = Budget(path.name, path.stat().st_size)
    out = cast("BinaryIO", tempfile.TemporaryFile())  # noqa: SIM115  (closed by whoever reads it)
    try:
        with path.open("rb") as file, _Hashed(file, digest) as hashed:
            stream = _stream(hashed, path.suffix.lower())
            try:
                while block := stream.read(_BLOCK):
                    budget.take(unpacked=len(block))
                    out.write(block)
            except DetectError:
                raise
            except ERRORS:
                whole = False
        if not out.tell():
            raise DetectError(
                "a compressed file that does not unpack", source=path.name, needed="a whole one", remedy="copy it again"
            )
    except BaseException:
        out.close()
        raise
    out.seek(0)
    return out, digest.hexdigest(), whole


def _stream(file: "IO[bytes]", suffix: str) -> "IO[bytes]":
    if suffix == ".gz":
        return cast("IO[bytes]", gzip.GzipFile(fileobj=file))
    worker = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW)
    return cast("IO[bytes]", worker.stream_reader(file, read_across_frames=True))


class _Hashed:
    """A file whose bytes are hashed as they are read."""

    def __init__(self, file: BinaryIO, digest: "hashlib._Hash") -> None:
        self._file, self._digest = file, digest

    def __enter__(self) -> "IO[bytes]":
        return cast("IO[bytes]", self)

    def __exit__(self, *_: object) -> None:
        while self.read(_BLOCK):
            pass

    def read(self, size: int = -1) -> bytes:
        block = self._file.read(size)
        self._digest.update(block)
        return block
