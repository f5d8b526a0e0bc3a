"""Hashes of what was read, for the provenance of results."""

import hashlib
from pathlib import Path

from boxcal.detect.errors import DetectError


def file_sha256(path: Path) -> str:
    """Return a file's SHA-256, hexadecimal (DetectError if it cannot be read)."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DetectError(
            f"cannot be read ({error.strerror or error})", source=path.name, remedy="check the path"
        ) from error


def joined_sha256(digests: list[str]) -> str:
    """Return one hash for the parts of a recording: that of their hashes in order; of one part its own."""
    return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
