"""The calibration so far: grown by each stop at once, and solved anew in full when there is time."""

import time
from dataclasses import replace

import numpy as np

from boxcal.calib.diagnosis.first_look import first_look
from boxcal.calib.diagnosis.frozen import frozen_stops
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.grown_fit import grown_fit
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS
from boxcal.target.box import Target


class RunningEstimate:
    """The estimate of a drive that still goes on.

    Attributes
    ----------
    estimate
        The last one; None as long as there is none.
    seen
        The drive as it was seen last; None before the first.
    drive
        What the estimate was made from: stops of frozen images without corners, landmarks where they are.
    problem
        Sentence about why there is none; empty if there is.
    seconds
        Time that the last update took, s.
    """

    def __init__(self, target: Target) -> None:
        self.estimate: Estimate | None = None
        self.seen: Correspondences | None = None
        self.drive: Correspondences | None = None
        self.problem = f"{MIN_STOPS} stops are needed for a first estimate"
        self.seconds = 0.0
        self._target = target
        self._fit: Fit | None = None
        self._as_seen = True

    def grow(self, drive: Correspondences) -> bool:
        """Take the drive with a further stop; return whether there is an estimate now."""
        begun = time.perf_counter()
        known, self.seen = self._fit, drive
        if known is None or self.drive is None or not self._as_seen:
            return self.solve(drive)
        if not _continues(self.drive, drive) or frozen_stops(drive.stops):
            return self.solve(drive)
        try:
            self._take(grown_fit(known, drive), drive, known.options)
        except (CalibError, np.linalg.LinAlgError) as error:
            self.problem = str(error)
        self.seconds = time.perf_counter() - begun
        return self.estimate is not None

    def solve(self, drive: Correspondences) -> bool:
        """Solve a drive anew, with camera model, variances and faults; return whether there is an estimate."""
        begun, self.seen = time.perf_counter(), drive
        if len(drive.stops) < MIN_STOPS:
            self.estimate, self._fit = None, None
            self.problem = f"{len(drive.stops)} of {MIN_STOPS} stops that a first estimate needs"
            return False
        try:
            look = first_look([drive], self._target)
            options = EstimateOptions(lens=None, target=look.target)
            self._as_seen = look.drives[0] is drive
            self._take(fit(look.drives, look.steps, options), look.drives[0], options)
        except (CalibError, np.linalg.LinAlgError) as error:
            self.problem = str(error)
        self.seconds = time.perf_counter() - begun
        return self.estimate is not None

    def _take(self, found: Fit, drive: Correspondences, options: EstimateOptions) -> None:
        estimate = reported(found, [drive], replace(options, slip=None))
        self._fit, self.drive, self.estimate, self.problem = found, drive, estimate, ""


def _continues(before: Correspondences, now: Correspondences) -> bool:
    """Return whether a drive begins with the stops that it had before, perhaps measured anew."""
    pairs = zip(before.stops, now.stops, strict=False)
    same = all(a.t_start_ns <= b.t_end_ns and b.t_start_ns <= a.t_end_ns for a, b in pairs)
    return same and len(before.stops) <= len(now.stops)
