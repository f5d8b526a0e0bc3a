"""Opens a recording of any kind, recognised by its first bytes, not by its name."""

import re
import shutil
import tempfile
from pathlib import Path
from typing import BinaryIO, cast

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.bag_folder import MAX_METADATA_BYTES, METADATA, BagFolder, folder_parts
from boxcal.detect.log.containers.base import Container
from boxcal.detect.log.containers.mcap import McapFile
from boxcal.detect.log.containers.mcap_indexed import IndexedMcap
from boxcal.detect.log.containers.mcap_records import MAGIC as MCAP_MAGIC
from boxcal.detect.log.containers.packing import unpacked_file
from boxcal.detect.log.containers.plain_folder import PlainFolder, is_plain_folder
from boxcal.detect.log.containers.ros1_bag import MAGIC as BAG_MAGIC
from boxcal.detect.log.containers.ros1_bag import Ros1Bag
from boxcal.detect.log.containers.sqlite import SqliteFile
from boxcal.detect.log.remote.range_file import opened_again
from boxcal.detect.log.remote.store import fetched, store_of
from boxcal.detect.log.remote.urls import is_url

_SQLITE_MAGIC = b"SQLite format 3\0"
_PACKED = (b"\x28\xb5\x2f\xfd", b"\x1f\x8b")
"""Zstandard's and gzip's first bytes."""
_NEEDED = "a recording of a robot is needed (MCAP, a ROS 2 bag or its folder, a ROS 1 bag)"
_PATTERN = re.compile(r"[*?\[]")
KINDS = (".mcap", ".db3", ".bag", ".active", ".zst", ".zstd", ".gz")
"""Suffixes of recordings."""


def open_container(path: Path, *, hashed: bool = True) -> Container:
    """Open a recording: a file of any kind, or a folder.

    Parameters
    ----------
    path
        The file or folder.
    hashed
        Whether the SHA-256 of its bytes is wanted, which takes longer than reading them.

    Raises
    ------
    DetectError
        If it is missing, empty, or no recording; behind a URL, if it cannot be reached or may not be read.
    """
    try:
        if is_url(path):
            return open_remote(path)
        if path.is_dir():
            return _open_folder(path, None if hashed else "")
        if path.exists() and not path.is_file():
            raise DetectError("neither a file nor a folder", source=path.name, needed=_NEEDED)
        return _open_file(path, None if hashed else "", packed=False)
    except FileNotFoundError as error:
        what = "no file matches this pattern" if _PATTERN.search(path.name) else "no such file"
        raise DetectError(what, source=str(path), needed=_NEEDED, remedy="check the path") from error
    except OSError as error:
        raise DetectError(
            f"cannot be read ({error.strerror or error})", source=path.name, remedy="check the file"
        ) from error


def open_stream(file: BinaryIO, name: str, digest: str | None = None) -> Container:
    """Open a recording from a file object that reads and seeks: MCAP or a ROS 1 bag.

    Raises
    ------
    DetectError
        If it is neither.
    """
    return _of_stream(file, name, digest)


def open_remote(path: Path) -> Container:
    """Open a recording behind a URL: of an MCAP with an index only what is needed is fetched, of others all.

    A bag folder is one whose only part is an MCAP, or it is read part by part. SQLite and compressed files are copied
    to a temporary file first.

    Raises
    ------
    DetectError
        If it cannot be reached, may not be read, or is no recording.
    """
    store = store_of(path)
    if store.is_folder():
        names = store.names()
        about = fetched(path / METADATA, MAX_METADATA_BYTES) if METADATA in names else b""
        parts, packed, notes = folder_parts(path, names, about)
        if len(parts) == 1 and not packed and parts[0].suffix == ".mcap":
            return _remote_file(parts[0], path.name, packed=False)
        return BagFolder(path, parts, lambda part: _remote_file(part, part.name, packed=packed), notes)
    return _remote_file(path, path.name, packed=False)


def _remote_file(path: Path, name: str, *, packed: bool) -> Container:
    remote = opened_again(store_of(path))
    file, digest = cast("BinaryIO", remote), remote.state.identity
    start = file.read(16)
    if start.startswith(_PACKED) or start == _SQLITE_MAGIC:
        copy = cast("BinaryIO", tempfile.NamedTemporaryFile(suffix=path.suffix))  # noqa: SIM115  (lives as its reader)
        file.seek(0)
        shutil.copyfileobj(file, copy, 8 << 20)
        copy.flush()
        remote.refuse_change()
        if start == _SQLITE_MAGIC:
            return SqliteFile.unpacked(copy, name, digest, packed=packed)
        container = _open_packed(Path(copy.name), packed=packed)
        container.name = name
        return container
    if start.startswith(MCAP_MAGIC) and not packed:
        return IndexedMcap(remote, name, digest)
    return _of_stream(file, name, digest, packed=packed)


def robot_name_of(path: Path) -> str:
    """Return what a robot is called by its recording: the file's name without its endings, or the folder's."""
    name = path.name
    if path.is_dir() or (is_url(path) and not path.suffix):
        return name
    if path.suffix.lower() in {".zst", ".zstd", ".gz", ".active"}:
        name = path.stem
    return Path(name).stem


def _open_folder(path: Path, digest: str | None) -> Container:
    if is_plain_folder(path):
        return PlainFolder(path)
    parts, packed, notes = folder_parts(path)
    return BagFolder(path, parts, lambda part: _open_file(part, digest, packed=packed), notes)


def _open_file(path: Path, digest: str | None, *, packed: bool) -> Container:
    with path.open("rb") as file:
        start = file.read(16)
    if start == _SQLITE_MAGIC:
        return SqliteFile(path, path.name, packed=packed, digest=digest)
    if start.startswith(_PACKED):
        return _open_packed(path, packed=packed)
    file = path.open("rb")
    try:
        return _of_stream(file, path.name, digest, packed=packed)
    except BaseException:
        file.close()
        raise


def _open_packed(path: Path, *, packed: bool) -> Container:
    file, digest, whole = unpacked_file(path)
    if file.read(16) == _SQLITE_MAGIC:
        return SqliteFile.unpacked(file, path.name, digest, packed=packed)
    try:
        container = _of_stream(file, path.name, digest, packed=packed)
    except BaseException:
        file.close()
        raise
    if not whole:
        container.damage.add("its compressed file is truncated or damaged, what unpacks of it is used")
    return container


def _of_stream(file: BinaryIO, name: str, digest: str | None, *, packed: bool = False) -> Container:
    file.seek(0)
    start = file.read(16)
    if start.startswith(MCAP_MAGIC):
        container = McapFile(file, name, digest)
        if packed:
            container.messages_are_packed()
        return container
    if start.startswith(BAG_MAGIC):
        return Ros1Bag(file, name, digest)
    if start.startswith(b"#ROSBAG V1"):
        found, remedy = "a ROS 1 bag of format 1", "convert it with `rosbag fix`"
    elif not start:
        found, remedy = "an empty file", "record again"
    elif MCAP_MAGIC.startswith(start):
        found, remedy = "an MCAP truncated in its first bytes", "record again"
    else:
        found, remedy = f"not an MCAP (begins with {start[:8].hex(' ')})", "record with `ros2 bag record -s mcap`"
    raise DetectError(found, source=name, needed=_NEEDED, remedy=remedy)
