"""Hashes of what was read, for the provenance of results."""

import hashlib
from pathlib import Path
from typing import BinaryIO

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Budget, Channel, Damage


class HashedFile:
    """A recording in one file, whose bytes may be hashed as they pass.

    Parameters
    ----------
    file
        Open for reading and seeking.
    name
        Of the file, for messages.
    digest
        Its SHA-256 where it is known already, empty where it is not wanted; None to hash what is read.
    """

    def __init__(self, file: BinaryIO, name: str, digest: str | None = None) -> None:
        self.name, self.damage = name, Damage()
        self._file, self._size = file, file.seek(0, 2)
        self._budget = Budget(name, self._size)
        self._channels: dict[int, Channel] = {}
        self._held: tuple[int, bytes | memoryview] = (-1, b"")
        self._known_digest = digest
        self._digest = hashlib.sha256()
        file.seek(0)

    def sha256(self) -> str:
        """Return the file's SHA-256, hexadecimal, once all batches were read."""
        return self._digest.hexdigest() if self._known_digest is None else self._known_digest

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _passed(self, data: bytes) -> bytes:
        """Hash bytes as they are read, if that is wanted."""
        if self._known_digest is None:
            self._digest.update(data)
        return data


def file_sha256(path: Path) -> str:
    """Return a file's SHA-256, hexadecimal (DetectError if it cannot be read)."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DetectError(
            f"cannot be read ({error.strerror or error})", source=str(path), remedy="check the path"
        ) from error


def joined_sha256(digests: list[str]) -> str:
    """Return one hash for the parts of a recording: that of their hashes in order; of one part its own."""
    return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
