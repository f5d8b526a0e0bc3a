"""A result with what its reader should know of its logs, and with its verdict."""

from collections.abc import Sequence
from dataclasses import replace

from boxcal.calib.assessment.verdict import judge
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target


def judged(result: Calibration, drives: Sequence[Correspondences], target: Target) -> Calibration:
    """Return a result with what a user should know of its logs, and with its verdict."""
    several = len(drives) > 1
    notes = [f"{d.source.log}: {note}" if several else note for d in drives for note in d.source.notes]
    result = replace(result, notes=(*notes, *result.notes))
    return replace(result, verdict=judge(result, drives, target))
