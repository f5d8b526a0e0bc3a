"""Robots that were calibrated from one recording: a copy under another name gives one robot's values to two."""

from collections.abc import Sequence

from boxcal.calib.results.calibration import Calibration
from boxcal.detect.log.remote.store import tells_content
from boxcal.detect.log.safe_text import listed


def said_of_copies(calibrations: Sequence[Calibration]) -> list[str]:
    """Return a line for each recording that several robots were calibrated from, compared by their logs' hashes."""
    robots: dict[frozenset[str], list[str]] = {}
    for c in calibrations:
        logs = frozenset(c.provenance.logs.values())
        if logs and all(map(tells_content, logs)):
            robots.setdefault(logs, []).append(c.robot)
    return [
        f"{listed(names)} were calibrated from one recording (the same bytes under several names), so all but one "
        "of them have another robot's values; give each robot its own log and calibrate again"
        for names in robots.values()
        if len(names) > 1
    ]
