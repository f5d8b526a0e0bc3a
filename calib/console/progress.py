"""Progress of a fleet's calibration: a live display on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from io import StringIO
from types import TracebackType
from typing import Protocol, Self, TextIO

from boxcal.calib.settings import NOTE, Outcome, Stage, listed

_EVERY_S = 2.0
"""Seconds between plain lines that only say how far a robot has come."""


class Progress(AbstractContextManager["Progress"], Protocol):
    """Receives what goes on; never raises, whatever becomes of the place that it writes to."""

    def stage(self, stage: Stage) -> None:
        """Report how far a robot has come."""

    def done(self, outcome: Outcome) -> None:
        """Report that a robot is finished or has failed."""


def make_progress(robots: int, *, quiet: bool, stream: TextIO | None = None) -> Progress:
    """Return the display that suits where it goes: nothing if quiet, live on a terminal, else lines."""
    stream = stream or sys.stderr
    if quiet:
        return _Silent()
    if stream.isatty():
        try:
            return _Live(robots, stream)
        except ImportError:  # an installation without rich still reports what goes on
            pass
    return _Lines(robots, stream)


class _Silent(AbstractContextManager["Progress"]):
    def __exit__(self, *_: object) -> None:
        return None

    def stage(self, stage: Stage) -> None:
        pass

    def done(self, outcome: Outcome) -> None:
        pass


class _Lines(AbstractContextManager["Progress"]):
    """A line for each new stage of a robot, and one every two seconds within a stage."""

    def __init__(self, robots: int, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._robots, self._stream, self._clock = robots, stream, clock
        self._start, self._last, self._count = clock(), 0.0, 0
        self._stages: dict[str, str] = {}
        self._shares: dict[str, float] = {}

    def __exit__(self, *_: object) -> None:
        return None

    def stage(self, stage: Stage) -> None:
        if stage.name == NOTE:
            self._say(f"{stage.robot}: {stage.text}")
            return
        now, self._shares[stage.robot] = self._clock(), stage.share
        if self._stages.get(stage.robot) == stage.name and now - self._last < _EVERY_S:
            return
        self._stages[stage.robot], self._last = stage.name, now
        self._say(f"{stage.robot}: {stage.text}")

    def done(self, outcome: Outcome) -> None:
        self._count += 1
        self._shares[outcome.job.robot] = 1.0
        self._say(f"[{self._count}/{self._robots}] {_finished(outcome)}{self._left()}")

    def _left(self) -> str:
        done = sum(self._shares.values())
        if self._count >= self._robots:
            return ""
        return f"; about {_duration((self._clock() - self._start) / done * (self._robots - done))} left"

    def _say(self, line: str) -> None:
        try:
            print(line, file=self._stream, flush=True)
        except OSError:  # whoever read it has gone; the work goes on
            self._stream = StringIO()


class _Live(AbstractContextManager["Progress"]):
    """A bar over all robots and one for each that is worked on, redrawn in place (rich)."""

    def __init__(self, robots: int, stream: TextIO) -> None:
        from rich import progress  # noqa: PLC0415  (not for pipes)
        from rich.console import Console  # noqa: PLC0415

        self._bars = progress.Progress(
            progress.TextColumn("{task.description}", markup=False),
            progress.BarColumn(bar_width=20),
            progress.TextColumn("{task.fields[text]}", markup=False),
            progress.TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(file=stream),
            transient=True,
        )
        self._all = self._bars.add_task("robots", total=robots, text=f"0 of {robots}")
        self._robots, self._count = robots, 0
        self._tasks: dict[str, progress.TaskID] = {}
        self._shares: dict[str, float] = {}

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def stage(self, stage: Stage) -> None:
        if stage.name == NOTE:
            self._bars.console.print(f"{stage.robot}: {stage.text}", markup=False, highlight=False)
            return
        if stage.robot not in self._tasks:
            self._tasks[stage.robot] = self._bars.add_task(stage.robot[:24], total=1.0, text="")
        self._bars.update(self._tasks[stage.robot], completed=stage.share, text=stage.text[:40])
        self._shares[stage.robot] = stage.share
        self._bars.update(self._all, completed=self._count + sum(self._shares.values()))

    def done(self, outcome: Outcome) -> None:
        robot = outcome.job.robot
        self._count += 1
        self._shares.pop(robot, None)
        if robot in self._tasks:
            self._bars.remove_task(self._tasks.pop(robot))
        self._bars.console.print(f"[{self._count}/{self._robots}] {_finished(outcome)}", markup=False, highlight=False)
        self._bars.update(
            self._all, completed=self._count + sum(self._shares.values()), text=f"{self._count} of {self._robots}"
        )


def _finished(outcome: Outcome) -> str:
    c = outcome.calibration
    word = "FAILED" if c is None else str(c.verdict.level) if c.verdict else "calibrated"
    return f"{listed(outcome.job.logs)}: {word} in {outcome.seconds:.1f} s"


def _duration(seconds: float) -> str:
    return (
        f"{seconds:.0f} s"
        if seconds < 90
        else f"{seconds / 60:.0f} min"
        if seconds < 5400
        else f"{seconds / 3600:.1f} h"
    )
