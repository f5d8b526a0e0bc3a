"""Saved correspondences behind a URL."""

import tempfile
from pathlib import Path

from boxcal.detect.correspondences import MAX_FILE_BYTES, Correspondences, load_correspondences
from boxcal.detect.log.remote.store import fetched
from boxcal.detect.log.remote.urls import is_url


def load_drive(path: Path) -> Correspondences:
    """Return saved correspondences, of this machine or behind a URL (DetectError if they cannot be read)."""
    if not is_url(path):
        return load_correspondences(path)
    with tempfile.TemporaryDirectory(prefix="boxcal-") as name:
        copy = Path(name) / path.name
        copy.write_bytes(fetched(path, MAX_FILE_BYTES))
        return load_correspondences(copy)
