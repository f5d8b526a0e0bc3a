"""The full calibration with its verdict, in a process of its own: it may take long, and may be given up."""

import importlib
import multiprocessing
import os
import threading
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

from boxcal.calib.settings import Job, Settings
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target

LONGEST_S = 90.0
"""A solver that has not answered by then is ended: drives of nonsense can keep it busy for minutes."""


class Solver:
    """Solves drives one at a time, in another process."""

    def __init__(self, robot: str, target: Target, settings: Settings | None = None) -> None:
        self._robot, self._target, self._settings = robot, target, settings or Settings()
        self._pool: ProcessPoolExecutor | None = None
        self._others: set[multiprocessing.process.BaseProcess] = set()

    def judge(self, drive: Correspondences) -> "Future[dict[str, object]]":
        """Begin to solve a drive; the result holds its verdict."""
        return self._submit(self._job(None, Path(drive.source.log or "drive"), ""), drive)

    def write(
        self, drive: Correspondences, out: Path, log: Path, command: str, *, recorded: bool
    ) -> "Future[dict[str, object]]":
        """Begin to solve a drive and write its results and report; the result holds its verdict.

        With ``recorded`` the drive is read from its log, as ``fleet-calibrate`` does, with the frames on the move.
        """
        return self._submit(self._job(out, log, command), drive, recorded=recorded)

    def get_ready(self) -> None:
        """Start the process and let it load what it needs, so that the first drive does not wait for that."""
        try:
            self._pool_there().submit(_load)
        except BrokenProcessPool:  # the next drive starts it again
            self.give_up()

    def give_up(self) -> None:
        """End the process, whatever it does."""
        if self._pool is not None:
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
            self._pool.shutdown(wait=False, cancel_futures=True)
        self._pool = None

    def _job(self, out: Path | None, log: Path, command: str) -> Job:
        settings = replace(self._settings, report=out is not None)
        return Job(robot=self._robot, logs=(log,), target=self._target, settings=settings, out=out, command=command)

    def _submit(self, job: Job, drive: Correspondences, *, recorded: bool = False) -> "Future[dict[str, object]]":
        try:
            return self._pool_there().submit(solved, job, drive, recorded=recorded)
        except BrokenProcessPool:  # it was ended from outside while it waited
            self.give_up()
            return self._submit(job, drive, recorded=recorded)

    def _pool_there(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._others = set(multiprocessing.active_children())
            self._pool = ProcessPoolExecutor(
                1, mp_context=multiprocessing.get_context("spawn"), initializer=end_with_guide
            )
        return self._pool


def end_with_guide() -> None:
    """Let this process end when the guide does, also if that is killed."""
    threading.Thread(target=_wait_for_guide, name="guide", daemon=True).start()


def _wait_for_guide() -> None:
    guide = multiprocessing.parent_process()
    if guide is not None:
        guide.join()
        os._exit(1)


def _load() -> None:
    importlib.import_module("boxcal.calib.calibrate")
    importlib.import_module("boxcal.calib.report.robot")


def solved(job: Job, drive: Correspondences, *, recorded: bool = False) -> dict[str, object]:
    """Return what a page shows of a solved drive: its verdict, and what the quick check finds in wheels and stops.

    With ``recorded`` it is read from the job's log.

    Raises
    ------
    BoxcalError
        If the drive does not determine the calibration.
    """
    from boxcal.calib.calibrate import calibrate_robot  # noqa: PLC0415  heavy, and for this process only
    from boxcal.calib.check_log.recorded import wheels_findings  # noqa: PLC0415
    from boxcal.calib.check_log.stops import stop_findings  # noqa: PLC0415
    from boxcal.calib.one_robot.from_drives import calibrate_drives  # noqa: PLC0415
    from boxcal.one_thread import hold_process_to_one_thread  # noqa: PLC0415

    hold_process_to_one_thread()
    found = calibrate_robot(job) if recorded else calibrate_drives(job, [drive])
    verdict = found.verdict
    if verdict is None:
        raise AssertionError("a calibration is judged before it is returned")
    wheels = wheels_findings(drive.wheels, drive.source.wheel_topics, drive.source.wheel_quantity)
    checked = [*wheels, *stop_findings(drive, job.target)]
    return {
        "level": str(verdict.level),
        "headline": verdict.headline,
        "lines": [list(line) for line in verdict.lines()],
        "checked": [[f.word, f.topic, f"{f.text} {f.advice}".strip()] for f in checked],
    }
