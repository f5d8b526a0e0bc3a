"""A plain folder: images with times in their names or in a CSV file, and ``wheels.csv``.

::

    robot07/
      wheels.csv               t,left,right      (seconds or ns; radians, or say --joint-unit)
      images/1700000000.250000.png ...           (the last number of the name is the time)
      images.csv               t,file            (instead of times in the names)
"""

import csv
import hashlib
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Batch, Channel, Damage, Place
from boxcal.detect.log.safe_text import listed, printable
from boxcal.detect.log.wheel_names import encoder_side, wheel_side

WHEELS = "wheels.csv"
PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff")
MAX_CSV_BYTES = 256 << 20
MAX_PICTURE_BYTES = 128 << 20
_MAX_PICTURES = 1_000_000
_TIMES_FILES = ("images.csv", "timestamps.csv", "stamps.csv", "times.csv", "data.csv")
_TIME_COLUMN = re.compile(r"^#?\s*(t|time|stamp|timestamp)(_?(ns|us|ms|s|sec))?(\s*\[(ns|us|ms|s)\])?$", re.IGNORECASE)
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_UNIT_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000, "sec": 1_000_000_000}
_ROWS = 1000


def is_plain_folder(path: Path) -> bool:
    """Return whether a folder is one of images with ``wheels.csv``."""
    return (path / WHEELS).is_file()


class PlainFolder:
    """A folder of images and ``wheels.csv``, open for reading."""

    kind = "folder of pictures"

    def __init__(self, path: Path) -> None:
        self.name, self.damage = path.name, Damage()
        self._path = path
        self._digest = hashlib.sha256()
        self._pictures: list[Path] = []

    def batches(self) -> Iterator[list[Batch]]:
        """Yield the wheels' rows as joint messages, then the images' times."""
        yield from self._wheels()
        found = self._timed_pictures()
        channel = Channel(topic="images", type="picture", encoding="picture")
        times: list[int] = []
        for t_ns, picture in found:
            self._pictures.append(picture)
            self._digest.update(f"{picture.name} {picture.stat().st_size}\n".encode())
            times.append(t_ns)
        none = np.zeros(len(found), dtype=np.int64)
        yield [Batch(channel, b"", none, none, np.array(times, dtype=np.int64), np.arange(len(found)))]

    def read(self, places: Iterable[Place]) -> Iterator[bytes]:
        """Yield the contents of images."""
        for record, _ in places:
            picture = self._pictures[record]
            if picture.stat().st_size > MAX_PICTURE_BYTES:
                raise DetectError(f"larger than {MAX_PICTURE_BYTES} bytes", source=f"{self.name}/{picture.name}")
            yield picture.read_bytes()

    def sha256(self) -> str:
        """Return a hash of ``wheels.csv`` and of the images' names and sizes."""
        return self._digest.hexdigest()

    def close(self) -> None:
        """Do nothing: no file stays open."""

    def _wheels(self) -> Iterator[list[Batch]]:
        path = self._path / WHEELS
        if path.stat().st_size > MAX_CSV_BYTES:
            raise DetectError(f"larger than {MAX_CSV_BYTES} bytes", source=f"{self.name}/{WHEELS}", remedy="split it")
        channel = Channel(topic=WHEELS, type="sensor_msgs/msg/JointState", encoding="json")
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            rows = csv.reader(file)
            head = next(rows, [])
            time, wheels = _columns(head, f"{self.name}/{WHEELS}")
            batch: list[tuple[bytes, int]] = []
            for number, row in enumerate(rows, 2):
                try:
                    t_ns = _time_ns(row[time], head[time])
                    numbers = [float(row[k]) if row[k].strip() else None for k in wheels]
                except (ValueError, IndexError, OverflowError):
                    self.damage.add(f"{WHEELS}: line {number} is no row of numbers, left out", messages=1)
                    continue
                sec, nanosec = divmod(t_ns, 1_000_000_000)
                known = [
                    (_wheel_name(head[k].strip()), v) for k, v in zip(wheels, numbers, strict=True) if v is not None
                ]
                stamp = {"sec": sec, "nanosec": nanosec}
                message = {"header": {"stamp": stamp}, "name": [n for n, _ in known], "position": [v for _, v in known]}
                batch.append((json.dumps(message).encode(), t_ns))
                if len(batch) == _ROWS:
                    yield [self._batch(channel, batch)]
                    batch = []
            if batch:
                yield [self._batch(channel, batch)]

    def _batch(self, channel: Channel, rows: list[tuple[bytes, int]]) -> Batch:
        data, starts, ends = b"".join(r for r, _ in rows), [], []
        at = 0
        for content, _ in rows:
            starts.append(at)
            at += len(content)
            ends.append(at)
        self._digest.update(data)
        log_ns = np.array([t for _, t in rows], dtype=np.int64)
        return Batch(channel, data, np.array(starts), np.array(ends), log_ns, 0)

    def _timed_pictures(self) -> list[tuple[int, Path]]:
        """Return the images with their times, ns, in order of time."""
        folder = self._path / "images" if (self._path / "images").is_dir() else self._path
        pictures = sorted(p for p in folder.iterdir() if p.suffix.lower() in PICTURES and p.is_file())[:_MAX_PICTURES]
        times = next((f / n for f in (self._path, folder) for n in _TIMES_FILES if (f / n).is_file()), None)
        found: list[tuple[int, Path]] = []
        if times is not None:
            by_name = {p.name: p for p in pictures}
            if times.stat().st_size > MAX_CSV_BYTES:
                raise DetectError(f"larger than {MAX_CSV_BYTES} bytes", source=f"{self.name}/{times.name}")
            with times.open(newline="", encoding="utf-8", errors="replace") as file:
                rows = csv.reader(file)
                head = next(rows, [])
                first = next((k for k, word in enumerate(head) if _TIME_COLUMN.match(word.strip())), 0)
                for row in rows:
                    names = [by_name[Path(w.strip()).name] for w in row if Path(w.strip()).name in by_name]
                    try:
                        found += [(_time_ns(row[first], head[first]), names[0])] if names else []
                    except (ValueError, IndexError, OverflowError):
                        self.damage.add(f"{times.name}: a line without a time, left out", messages=1)
        else:
            for picture in pictures:
                numbers = _NUMBER.findall(picture.stem)
                if numbers:
                    found.append((_time_ns(numbers[-1], ""), picture))
                else:
                    self.damage.add(f"{printable(picture.name)}: no time in its name, left out", messages=1)
        if pictures and not found:
            raise DetectError(
                f"{len(pictures)} pictures without times",
                source=self.name,
                needed="the time in each name (1700000000.250000.png), or images.csv with the columns t,file",
                remedy="rename them, or write that file",
            )
        return sorted(found, key=lambda pair: pair[0])


def _columns(head: list[str], who: str) -> tuple[int, list[int]]:
    """Return the columns of the time and of the wheels (or all others, for the user to name)."""
    times = [k for k, word in enumerate(head) if _TIME_COLUMN.match(word.strip())]
    if not times:
        raise DetectError(
            f"columns {listed(head)}", source=who, needed="a column t (or time_s, stamp_ns ...) and one for each wheel"
        )
    others = [k for k in range(len(head)) if k != times[0]]
    wheels = [k for k in others if wheel_side(head[k]) or encoder_side(f"wheel_{head[k]}")]
    return times[0], wheels or others[:100]


def _wheel_name(column: str) -> str:
    """Return a joint's name that says which wheel a column is: ``left`` alone says so only here."""
    return f"wheel_{column}" if not wheel_side(column) and wheel_side(f"wheel_{column}") else column


def _time_ns(text: str, column: str) -> int:
    """Return a time in ns: by its column's unit, else by its size (of now: ns, us, ms or s since 1970)."""
    found = _TIME_COLUMN.match(column.strip())
    unit = next((u for u in (found.group(3), found.group(5)) if u), None) if found else None
    whole, _, part = text.strip().partition(".")
    value = int(whole)
    if unit is None:
        size = abs(value)
        unit = "ns" if size > 10**16 else "us" if size > 10**13 else "ms" if size > 10**11 else "s"
    scale = _UNIT_NS[unit.lower()]
    fraction = round(float(f"0.{part}") * scale) if part else 0
    t_ns = value * scale + (fraction if not text.strip().startswith("-") else -fraction)
    if abs(t_ns) > 1 << 62:
        raise OverflowError(text)
    return t_ns
