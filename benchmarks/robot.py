"""Processor time of one robot, from its log to written results, stage by stage beside the floor of each.

python benchmarks/robot.py                  the path-traced khepera log, and a simulated one of 20 stops, 120 frames
python benchmarks/robot.py robots/*.mcap
python benchmarks/robot.py --robots 2 20 200   fleets of one log, copied: cost a robot, how busy the cores are, memory

One thread, processor time of this process after a first robot that is not counted (imports, compiled code); of some
repeats the least. Floors are what the libraries alone take for the same bytes: chunks decompressed, the frames at stops
decoded to grey by OpenCV; a detection's is OpenCV's own, without refinement, of one frame a stop. Of a fleet the
processes' start is estimated from two sizes: the cost of a further robot is the difference over the robots between.
"""

import argparse
import os
import resource
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import lz4.frame
import numpy as np
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from tag_detectors import opencv
from tag_scenes import TARGET

from boxcal.calib import calibrate as calibrating
from boxcal.calib.assessment.verdict import judge
from boxcal.calib.fleet.batch import calibrate_fleet
from boxcal.calib.one_robot import from_drives, judging
from boxcal.calib.one_robot.solving import solve
from boxcal.calib.one_robot.writing import write
from boxcal.calib.settings import Job, Settings
from boxcal.calib.simulate.cli import main as simulate_fleet
from boxcal.detect import extract as extracting
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.tags import box_at_stops
from boxcal.detect.tags.stop_measurement import measure_stop
from boxcal.one_thread import one_thread

KHEPERA = Path(__file__).resolve().parents[2] / "shared" / "data" / "fleet" / "khepera.mcap"
STAGES = ("read the log", "decode", "measure the stops", "solve", "verdict", "write with report")


class Stopwatch:
    """Processor time by stage; a stage within another counts for itself alone."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._running: list[str] = []
        self._since = 0.0

    def _book(self) -> None:
        now = time.process_time()
        if self._running:
            self.seconds[self._running[-1]] += now - self._since
        self._since = now

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Book what runs within."""
        self._book()
        self._running.append(name)
        try:
            yield
        finally:
            self._book()
            self._running.pop()

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function whose time is booked."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.stage(name):
                return function(*args, **kwargs)

        return timed

    def along(self, name: str, function: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
        """Return a generator whose own time is booked, not that of who takes its items."""

        def timed(*args: Any, **kwargs: Any) -> Iterator[Any]:
            items = iter(function(*args, **kwargs))
            while True:
                with self.stage(name):
                    item = next(items, self)
                if item is self:
                    return
                yield item

        return timed


def robot(log: Path, out: Path) -> tuple[Counter[str], float]:
    """Return the processor time of each stage and of all, s, of one robot calibrated."""
    watch = Stopwatch()
    job = Job(robot=log.stem, logs=(log,), target=TARGET, settings=Settings(), out=out)
    frames = box_at_stops.BoxAtStops._images  # noqa: SLF001 - measured, not used
    start = time.process_time()
    with (
        mock.patch.object(extracting, "open_recording", watch.around(STAGES[0], open_recording)),
        mock.patch.object(box_at_stops.BoxAtStops, "_images", watch.along(STAGES[1], frames)),
        mock.patch.object(box_at_stops, "measure_stop", watch.around(STAGES[2], measure_stop)),
        mock.patch.object(from_drives, "solve", watch.around(STAGES[3], solve)),
        mock.patch.object(judging, "judge", watch.around(STAGES[4], judge)),
        mock.patch.object(from_drives, "write", watch.around(STAGES[5], write)),
    ):
        calibrating.calibrate_robot(job)
    return watch.seconds, time.process_time() - start


def floors(log: Path) -> dict[str, float]:
    """Return what libraries alone take, s."""
    start = time.process_time()
    pictures = []
    with log.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                _decompressed(record)
    told = {STAGES[0]: time.process_time() - start}
    found = box_at_stops.BoxAtStops
    kept: list[Any] = []
    frames = found._images  # noqa: SLF001

    def keep(*args: Any) -> Iterator[Any]:
        for image in frames(*args):
            kept.append(image)
            yield image

    with mock.patch.object(found, "_images", keep):
        drive = extracting.extract(log, TARGET)
    pictures = [np.asarray(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]) for image in kept]
    start = time.process_time()
    for picture in pictures:
        cv2.imdecode(picture, cv2.IMREAD_GRAYSCALE)
    told[STAGES[1]] = time.process_time() - start
    peer = opencv(cv2.aruco.CORNER_REFINE_NONE)
    start = time.process_time()
    for image in kept[:: max(1, len(kept) // max(len(drive.stops), 1))]:
        peer(image)
    told[STAGES[2]] = time.process_time() - start
    return told


def fleet(log: Path, robots: int, folder: Path) -> tuple[float, float, float]:
    """Return processor time, time by the clock, s, and the largest memory of a process, MB, of a number of robots."""
    logs = [folder / f"r{k:03d}{log.suffix}" for k in range(robots)]
    for path in logs:
        shutil.copyfile(log, path)
    jobs = [Job(robot=path.stem, logs=(path,), target=TARGET, settings=Settings(), out=folder / "out") for path in logs]
    clock, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    failed = [outcome.error for outcome in calibrate_fleet(jobs) if outcome.error is not None]
    clock, after = time.monotonic() - clock, resource.getrusage(resource.RUSAGE_CHILDREN)
    if failed:
        raise SystemExit(f"{len(failed)} of {robots} robots failed: {failed[0]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, clock, after.ru_maxrss / 1024


def fleets(log: Path, sizes: Sequence[int]) -> None:
    """Print what a robot costs in fleets of several sizes."""
    cores = os.cpu_count() or 1
    print(f"{log.name}, {cores} cores, load before {os.getloadavg()[0]:.1f}")
    print("| robots | processor s | s a robot | s a further robot | by the clock s | cores busy | worker MB |")
    print("|---|---|---|---|---|---|---|")
    less: tuple[int, float] | None = None
    for robots in sorted(sizes):
        with tempfile.TemporaryDirectory() as folder:
            used, clock, memory = fleet(log, robots, Path(folder))
        further = "" if less is None else f"{(used - less[1]) / (robots - less[0]):.2f}"
        print(
            f"| {robots} | {used:.1f} | {used / robots:.2f} | {further} | {clock:.1f} | {used / clock / cores:.0%} "
            f"| {memory:.0f} |",
            flush=True,
        )
        less = (robots, used)


def _decompressed(chunk: Chunk) -> bytes:
    if chunk.compression == "zstd":
        return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=chunk.uncompressed_size)
    if chunk.compression == "lz4":
        return bytes(lz4.frame.decompress(chunk.data))
    return chunk.data


@one_thread()
def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="logs in MCAP")
    parser.add_argument("--robots", nargs="+", type=int, default=[], help="sizes of fleets to measure instead")
    parser.add_argument("--repeat", type=int, default=3, help="times that each is measured (3)")
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        logs = list(options.logs)
        if not logs:
            with redirect_stdout(StringIO()):
                simulate_fleet([folder, "--robots", "1", "--stops", "20", "--frames", "6", "--moving-frames", "0"])
            logs = [*([KHEPERA] if KHEPERA.is_file() else []), Path(folder) / "r01.mcap"]
        if options.robots:
            fleets(logs[0], options.robots)
            return 0
        robot(logs[0], Path(folder) / "first")
        for log in logs:
            least = floors(log)
            stages, total = min((robot(log, Path(folder) / "out") for _ in range(options.repeat)), key=lambda r: r[1])
            print(f"{log.name}: {1e3 * total:.0f} ms\n| stage | ms | floor ms |\n|---|---|---|")
            for name in STAGES:
                floor = f"{1e3 * least[name]:.0f}" if name in least else ""
                print(f"| {name} | {1e3 * stages[name]:.0f} | {floor} |")
            print(f"| the rest | {1e3 * (total - sum(stages.values())):.0f} | |\n", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
