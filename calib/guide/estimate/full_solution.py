"""The full calibration under way, its last verdict, and why the last one failed."""

import tempfile
import time
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from boxcal.calib.guide.estimate.solver import LONGEST_S, Solver
from boxcal.detect.correspondences import Correspondences
from boxcal.target.errors import BoxcalError


class Copy(NamedTuple):
    """A finished copy of the recording, in a folder that is removed with it."""

    path: Path
    folder: "tempfile.TemporaryDirectory[str]"


class FullSolution:
    """One drive's full calibrations, one at a time.

    Attributes
    ----------
    verdict
        Of the last one, and of how many stops; empty before, and if it failed.
    written
        That of the last one that was written; empty before.
    failed
        Sentence about why the last one failed; empty if it did not.
    """

    def __init__(self, solver: Solver) -> None:
        self.verdict: dict[str, Any] = {}
        self.written: dict[str, Any] = {}
        self.failed = ""
        self._solver = solver
        self._future: Future[dict[str, Any]] | None = None
        self._since, self._stops, self._writes = 0.0, 0, False
        self._copy: Copy | None = None

    @property
    def idle(self) -> bool:
        """Whether none is under way."""
        return self._future is None

    @property
    def is_writing(self) -> bool:
        """Whether one that is written is under way."""
        return self._future is not None and self._writes

    def get_ready(self) -> None:
        """Have the solver loaded beforehand."""
        self._solver.get_ready()

    def judge(self, drive: Correspondences) -> None:
        """Begin to solve a drive for its verdict; only while idle."""
        self._begin(self._solver.judge(drive), drive, writes=False)

    def write(self, drive: Correspondences, out: Path, log: Path, command: str, copy: Copy | str) -> None:
        """Begin to solve a drive and to write its results; one that is under way is given up.

        Parameters
        ----------
        drive
            What was measured meanwhile.
        out, command
            Where results go; the command line for their provenance.
        log
            The recording.
        copy
            A finished copy of it, which the results are made from: then they are those of the recording; removed when
            it has been read. Or a sentence about why there is none: then they are made from what was measured on the
            way, and say so.
        """
        self.give_up()
        self.written = {}
        if isinstance(copy, Copy):
            self._copy, log = copy, copy.path
        else:
            said = "calibrated from the stops measured on the way, without frames on the move, not from the recording"
            drive = replace(drive, source=replace(drive.source, notes=(*drive.source.notes, f"{said}: {copy}")))
        self._begin(self._solver.write(drive, out, log, command, recorded=isinstance(copy, Copy)), drive, writes=True)

    def give_up(self) -> None:
        """End what is under way."""
        if self._future is not None:
            self._solver.give_up()
        self._future = None
        self._let_go()

    def collect(self) -> bool:
        """Take what is finished; return whether results were written."""
        full = self._future
        if full is None:
            return False
        if not full.done():
            if time.monotonic() - self._since > LONGEST_S:
                self.give_up()
                self._fail(f"{self._stops} stops were not solved within {LONGEST_S:.0f} s; drive on")
            return False
        self._future = None
        self._let_go()
        try:
            self.verdict = {**full.result(), "stops": self._stops}
        except (BoxcalError, OSError, cv2.error, np.linalg.LinAlgError) as error:
            self._fail(str(error))
            return False
        except (BrokenProcessPool, CancelledError):
            self._solver.give_up()
            self._fail("the solver ended unexpectedly; it is started again with the next stop")
            return False
        self.failed = ""
        if self._writes:
            self.written = self.verdict
        return self._writes

    def _let_go(self) -> None:
        if self._copy is not None:
            self._copy.folder.cleanup()
        self._copy = None

    def _fail(self, why: str) -> None:
        self.verdict, self.failed = {}, why

    def _begin(self, future: "Future[dict[str, Any]]", drive: Correspondences, *, writes: bool) -> None:
        self._future, self._writes = future, writes
        self._since, self._stops = time.monotonic(), len(drive.stops)
