"""Corners far from where the rest of their sheet has them, as of exchanged landmarks, and the drive without them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from boxcal.calib.diagnosis.scrambled_stops import MOST, NEAR, affine_misfit, missed_views, scrambled_stops
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences, StopObservation

FAR = 0.3
"""A corner is odd that misses its sheet's view by more than this fraction of the sheet's spread; few of a fisheye's
do."""


CORNERS_ODD = "corners-odd"
"""The cause's name."""
GROSS = 0.05
"""Fraction of a drive's corners that may be odd in a result that is allowed for as it is."""


def odd_corners(stop: StopObservation) -> NDArray[np.bool_]:
    """Return which corners (L,) of a stop are odd: all of a sheet on which no majority agrees on a view."""
    missed = missed_views(stop)
    odd = missed > FAR
    for face in np.unique(stop.faces):
        on = stop.faces == face
        if not np.isnan(missed[on]).any() and np.mean(missed[on] <= NEAR) < MOST:
            odd |= on
    return odd


def without_odd_corners(
    drives: Sequence[Correspondences], least_misfit: float = 0.0
) -> tuple[list[Correspondences], list[Finding]]:
    """Return drives without odd corners, and what is said of them: nothing if there are none.

    A few such corners at many stops leave no camera to begin with, before any test for outliers, and a sheet of them no
    place of the box. Looked at are stops whose corners miss an affine view of the box by so much, root mean square over
    their spread; not those without any right corners.
    """
    sound, findings = [], []
    for drive in drives:
        stops, counts = list(drive.stops), dict[int, int]()
        near = [len(s.landmark_ids) < 1 or affine_misfit(s) < least_misfit for s in stops]
        scrambled = () if all(near) else scrambled_stops(drive.stops)
        for j, stop in enumerate(drive.stops):
            odd = np.zeros(0, dtype=np.bool_) if near[j] or j in scrambled else odd_corners(stop)
            if odd.any():
                stops[j], counts[j] = _taken(stop, ~odd), int(odd.sum())
        sound.append(replace(drive, stops=tuple(stops)))
        if counts:
            findings.append(_finding(counts, drive.stops))
    return sound, findings


def said_with_odd_corners(error: CalibError, findings: Sequence[Finding]) -> CalibError:
    """Return why drives cannot be calibrated, after what is said of odd corners where they had some."""
    for finding in findings:
        if finding.cause == CORNERS_ODD:
            found = f"{finding.text}; without them: {error.found}"
            return CalibError(found, source=error.source, needed=error.needed, remedy=finding.advice)
    return error


def _taken(stop: StopObservation, kept: NDArray[np.bool_]) -> StopObservation:
    return replace(
        stop,
        **{name: getattr(stop, name)[kept] for name in ("landmark_ids", "faces", "p_box", "uv_px", "cov_px2")},
    )


def _finding(counts: dict[int, int], stops: Sequence[StopObservation]) -> Finding:
    numbers, count, seen = ", ".join(str(j + 1) for j in counts), sum(counts.values()), sum(len(s.faces) for s in stops)
    return Finding(
        cause=CORNERS_ODD,
        text=f"{count} of {seen} corners (stop{'s' if len(counts) > 1 else ''} {numbers} of {len(stops)}) are far from "
        "where the rest of their sheets has them, as if pixels were assigned to other landmarks: they were left out",
        advice="Check the order of landmarks and pixels where they were saved, and the box's target.json.",
        adopted=count <= GROSS * seen,
        stops=tuple(counts),
    )
