"""Writing results so that a crash or a full disk never leaves half a file."""

import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from boxcal.target.errors import TargetError

PART = ".part"
"""End of the names of what is being written."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: beside its place first, then renamed over it.

    The folder is made if it is missing. Raises OSError as the file system does.
    """
    write_pieces_atomically(path, (content,))


def write_pieces_atomically(path: Path, pieces: Iterable[bytes]) -> None:
    """Write a file that comes in pieces, as :func:`write_atomically` does."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:40]}.", suffix=PART)
    try:
        with os.fdopen(handle, "wb") as file:
            file.writelines(pieces)
            file.flush()
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        Path(name).chmod(0o666 & ~umask)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_together(folder: Path, files: Mapping[str, bytes], *, stale: Iterable[str] = ()) -> None:
    """Write files so that a full disk leaves none of them half written, nor some without the others.

    They appear in their order, the last of them when all others are there.

    Parameters
    ----------
    folder
        Made if it is missing.
    files
        By their paths within the folder.
    stale
        Files to remove, once all others are sure to be written.

    Raises
    ------
    TargetError
        If a folder stands where a file is to be written.
    OSError
        As the file system does.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in files:
        if (folder / name).is_dir():
            raise TargetError(
                "is a folder, a file is to be written there", source=folder / name, remedy="name another FOLDER"
            )
    with tempfile.TemporaryDirectory(dir=folder, prefix=".written-together.", suffix=PART) as staging:
        for name, content in files.items():
            write_atomically(Path(staging) / name, content)
        for name in files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
        for name in stale:
            (folder / name).unlink(missing_ok=True)
        for name in files:
            (Path(staging) / name).replace(folder / name)


def clear_parts(folder: Path) -> None:
    """Remove what a process that was ended by force left half written in a folder; nobody may be writing there."""
    for path in folder.glob(f".*{PART}"):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
