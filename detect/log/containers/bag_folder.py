"""ROS 2's normal output, a folder with ``metadata.yaml``: one or more parts as one drive, compressed or not."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Batch, Container, Damage, Place
from boxcal.detect.log.containers.hashing import joined_sha256
from boxcal.detect.log.safe_text import printable

METADATA = "metadata.yaml"
MAX_METADATA_BYTES = 4 << 20
_MAX_PARTS = 10_000
_MAX_YAML = 1 << 18
_BLOCKS = re.compile(r"^  (topics_with_message_count|files|custom_data):.*\n((?: {3,}|  -).*\n)*", re.MULTILINE)
"""The long parts of the metadata, which say nothing that the recordings do not."""
PARTS = (".mcap", ".db3", ".mcap.zst", ".mcap.zstd", ".db3.zstd", ".db3.zst", ".mcap.gz", ".bag")


class BagFolder:
    """A bag folder, open for reading, part by part."""

    def __init__(self, path: Path, parts: list[Path], open_part: "Any", notes: Iterable[str] = ()) -> None:
        self.name, self.damage = path.name, Damage()
        self._parts, self._open = parts, open_part
        self._opened: tuple[int, Container] | None = None
        self._digests: dict[int, str] = {}
        for note in notes:
            self.damage.add(note)
        self.kind = "ROS 2 bag folder"

    def batches(self) -> Iterator[list[Batch]]:
        """Yield the messages of all parts, one after the other; a part that cannot be opened is left out and said."""
        usable, last = 0, DetectError("")
        for number, part in enumerate(self._parts):
            try:
                container = self._part(number)
            except DetectError as error:
                last = error
                self.damage.add(f"part {printable(part.name)} cannot be used: {error.found}")
                continue
            usable += 1
            for piece in container.batches():
                yield [batch._replace(record=batch.record + (number << 48)) for batch in piece]
            self._digests[number] = container.sha256()
            for note in container.damage.notes:
                self.damage.add(f"{printable(part.name)}: {note}" if len(self._parts) > 1 else note)
            self.damage.messages += container.damage.messages
            self.damage.spans_ns += container.damage.spans_ns
        if not usable:
            raise last.of(self.name)

    def read(self, places: Iterable[Place]) -> Iterator[bytes]:
        """Yield messages at places that :meth:`batches` gave."""
        for place in places:
            number, record = place.record >> 48, place.record & ((1 << 48) - 1)
            yield from self._part(number).read([place._replace(record=record)])

    def sha256(self) -> str:
        """Return the hash of its parts' hashes; of one part its own."""
        return joined_sha256([self._digests[k] for k in sorted(self._digests)])

    def close(self) -> None:
        """Close the part that is open."""
        if self._opened is not None:
            self._opened[1].close()
            self._opened = None

    def _part(self, number: int) -> Container:
        if self._opened is None or self._opened[0] != number:
            self.close()
            container: Container = self._open(self._parts[number])
            self._opened = (number, container)
        return self._opened[1]


def folder_parts(
    path: Path, names: Iterable[str] | None = None, metadata: bytes | None = None
) -> tuple[list[Path], bool, list[str]]:
    """Return the parts of a bag folder in order, whether its messages are compressed one by one, and what is odd.

    The metadata names the parts; where it is missing or damaged, as after a crash, recordings that are numbered as
    parts of one bag are taken by name. Names that lead out of the folder are not followed.

    Parameters
    ----------
    path
        The folder.
    names, metadata
        Of its files, and what ``metadata.yaml`` holds, where the folder is not on this machine.

    Raises
    ------
    DetectError
        If the folder holds no recording, or several that are no parts of one.
    """
    files = [p for p in path.iterdir() if p.is_file()] if names is None else [path / name for name in names]
    there = sorted((p for p in files if p.name.lower().endswith(PARTS)), key=_natural)[:_MAX_PARTS]
    about, notes = _metadata(_text(path / METADATA) if metadata is None else metadata), []
    packed = str(about.get("compression_mode", "")).upper() == "MESSAGE" and bool(about.get("compression_format"))
    named = about.get("relative_file_paths")
    if isinstance(named, list) and named:
        by_name = {p.name: p for p in there}
        parts = [by_name[Path(str(n)).name] for n in named[:_MAX_PARTS] if Path(str(n)).name in by_name]
        missing = [str(n) for n in named[:_MAX_PARTS] if Path(str(n)).name not in by_name]
        if missing:
            notes.append(f"{len(missing)} of its {len(named)} parts are missing ({printable(missing[0])} ...)")
        there = parts or there
    elif len({_stem(p) for p in there}) > 1:
        raise DetectError(
            f"a folder of {len(there)} recordings of their own ({printable(there[0].name)}, ...) and no {METADATA}",
            source=path.name,
            needed="one recording or the numbered parts of one bag are needed",
            remedy=f"name the recordings themselves: {printable(path.name)}/*{there[0].suffix}",
        )
    elif there:
        notes.append(f"no whole {METADATA}; the recordings in the folder were taken by name")
    if not there:
        raise DetectError(
            "a folder without a recording",
            source=path.name,
            needed=f"a bag ({METADATA} with .mcap or .db3 files), or images with wheels.csv",
            remedy="name the recording itself",
        )
    return there, packed, notes


def _stem(path: Path) -> str:
    """Return the name that the parts of one bag share: what stands before ``_0.mcap``."""
    return _PART.sub("", path.name.lower())


_PART = re.compile(r"_\d+(?=\.)")


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts ``bag_10`` behind ``bag_9``."""
    text = "".join(c if c.isdigit() else f" {c} " for c in path.name)
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in text.split()]


def _text(path: Path) -> bytes:
    """Return a file's content, nothing where it is missing or too large."""
    try:
        return path.read_bytes() if path.stat().st_size <= MAX_METADATA_BYTES else b""
    except OSError:
        return b""


def _metadata(content: bytes) -> dict[str, Any]:
    """Return what ``metadata.yaml`` says; nothing where it is no YAML."""
    from ruamel.yaml import YAML  # noqa: PLC0415  (only for folders)
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415

    try:
        text = _BLOCKS.sub("", content.decode())
        if len(text) > _MAX_YAML or "&" in text:  # anchors multiply; rosbag2 writes none
            return {}
        about = YAML(typ="safe", pure=True).load(text)["rosbag2_bagfile_information"]
    except (YAMLError, ValueError, TypeError, KeyError, RecursionError, AttributeError):
        return {}
    return about if isinstance(about, dict) else {}
