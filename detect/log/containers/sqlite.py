"""ROS 2 bags in sqlite3 storage (.db3): the tables ``topics`` and ``messages`` that rosbag2 writes."""

import shutil
import sqlite3
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO, Self
from urllib.parse import quote

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import (
    MAX_RECORD_BYTES,
    MAX_SCHEMA_BYTES,
    Batch,
    Budget,
    Channel,
    Damage,
    Place,
    checked_name,
)
from boxcal.detect.log.containers.hashing import file_sha256
from boxcal.detect.log.safe_text import printable

_ROWS = 512
_PIECE_BYTES = 8 << 20
_MAX_TOPICS = 10_000
_LIMIT_LENGTH, _LIMIT_SQL, _LIMIT_ATTACHED = 0, 1, 7  # sqlite3.SQLITE_LIMIT_*, whose names came with Python 3.11
_NEEDED = "a ROS 2 bag"


class SqliteFile:
    """A ``.db3`` file, open for reading."""

    kind = "ROS 2 bag (sqlite3)"

    def __init__(self, path: Path, name: str, *, packed: bool = False, digest: str | None = None) -> None:
        self.name, self.damage = name, Damage()
        self._path, self._packed, self._digest, self._remove = path, packed, digest, False
        self._budget = Budget(name, path.stat().st_size)
        self._base = sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1", uri=True)
        try:
            self._base.text_factory = lambda text: text.decode("utf-8", "replace")
            self._base.setlimit(_LIMIT_LENGTH, MAX_RECORD_BYTES)
            self._base.setlimit(_LIMIT_SQL, 1 << 20)
            self._base.setlimit(_LIMIT_ATTACHED, 0)
            self._base.execute("PRAGMA trusted_schema=OFF")
            self._channels = self._topics()
        except DetectError:
            self._base.close()
            raise
        except (sqlite3.Error, ValueError, TypeError) as error:
            self._base.close()
            raise DetectError(f"does not open ({printable(str(error))})", source=name, needed=_NEEDED) from error

    @classmethod
    def unpacked(cls, file: BinaryIO, name: str, digest: str, *, packed: bool) -> Self:
        """Open a database that was unpacked into a temporary file; sqlite needs one with a name."""
        file.seek(0)
        with file, tempfile.NamedTemporaryFile(suffix=".db3", delete=False) as named:
            path = Path(named.name)
            shutil.copyfileobj(file, named, 1 << 20)
        try:
            base = cls(path, name, packed=packed, digest=digest)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        base._remove = True
        return base

    def batches(self) -> Iterator[list[Batch]]:
        """Yield all messages in the order of their rows."""
        held: dict[int, tuple[list[bytes], list[int], list[int]]] = {}
        size = count = 0
        try:
            with closing(self._base.cursor()) as cursor:
                for row, topic, log, data in cursor.execute("SELECT id, topic_id, timestamp, data FROM messages"):
                    if topic not in self._channels or not isinstance(data, bytes):
                        continue
                    if not isinstance(log, int) or not isinstance(row, int):
                        continue
                    datas, rows, logs = held.setdefault(topic, ([], [], []))
                    datas.append(data)
                    rows.append(row)
                    logs.append(log)
                    size, count = size + len(data), count + 1
                    if size > _PIECE_BYTES or count == _ROWS:
                        self._budget.take(messages=count)
                        yield self._piece(held)
                        held, size, count = {}, 0, 0
        except sqlite3.Error as error:
            self.damage.add(f"its database is damaged ({printable(str(error))}), what stands before is used")
        yield self._piece(held)

    def read(self, places: Iterable[Place]) -> Iterator[bytes]:
        """Yield the messages of rows."""
        for row, _ in places:
            try:
                found = self._base.execute("SELECT data FROM messages WHERE id = ?", (row,)).fetchone()
            except sqlite3.Error as error:
                raise DetectError(f"cannot be read again ({printable(str(error))})", source=self.name) from error
            if found is None or not isinstance(found[0], bytes):
                raise DetectError(
                    "changed while it was read", source=self.name, remedy="close its recorder and try again"
                )
            yield found[0]

    def sha256(self) -> str:
        """Return the file's SHA-256, hexadecimal."""
        return file_sha256(self._path) if self._digest is None else self._digest

    def close(self) -> None:
        """Close the database; what was unpacked for it goes."""
        self._base.close()
        if self._remove:
            self._path.unlink(missing_ok=True)

    def _piece(self, held: dict[int, tuple[list[bytes], list[int], list[int]]]) -> list[Batch]:
        """Return a batch for each topic: the place of a message is its row."""
        batches = []
        for topic, (datas, rows, logs) in held.items():
            ends = np.cumsum([len(d) for d in datas], dtype=np.int64)
            starts = np.concatenate([[0], ends[:-1]])
            log_ns, records = np.array(logs, dtype=np.int64), np.array(rows, dtype=np.int64)
            batches.append(Batch(self._channels[topic], b"".join(datas), starts, ends, log_ns, records))
        return batches

    def _topics(self) -> dict[int, Channel]:
        tables = {name for (name,) in self._base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise DetectError("a database without the tables topics and messages", source=self.name, needed=_NEEDED)
        texts: dict[str, tuple[str, bytes]] = {}
        if "message_definitions" in tables:
            rows = self._base.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions LIMIT ?",
                (_MAX_TOPICS,),
            )
            for kind, language, text in rows:
                if isinstance(text, str) and len(text) <= MAX_SCHEMA_BYTES:
                    texts[str(kind)] = (str(language), text.encode())
        channels = {}
        rows = self._base.execute("SELECT id, name, type, serialization_format FROM topics LIMIT ?", (_MAX_TOPICS,))
        for number, topic, kind, encoding in rows:
            language, text = texts.get(str(kind), ("", b""))
            channels[int(number)] = Channel(
                topic=checked_name(str(topic), "topic"),
                type=checked_name(str(kind), "type"),
                encoding=str(encoding),
                schema=text,
                schema_encoding=language,
                packed=self._packed,
            )
        return channels
