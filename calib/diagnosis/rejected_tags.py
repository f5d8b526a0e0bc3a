"""Tags that were read but do not lie where the box has them, as with another box or a second one."""

from collections.abc import Sequence

from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import StopObservation
from boxcal.target.box import CORNERS

MANY = 0.1
"""Tags rejected for each one used from which on the box is not as described."""
LEAST_STOPS = 2
"""At this many stops at least: at one of them it may be a reflection."""


def rejected_finding(stops: Sequence[StopObservation]) -> Finding | None:
    """Return what is said of tags that were read but do not fit the box; None if they are few."""
    used = sum(len(stop.landmark_ids) // CORNERS for stop in stops)
    at = tuple(j for j, stop in enumerate(stops) if stop.rejected_tags)
    rejected = sum(stop.rejected_tags for stop in stops)
    if len(at) < LEAST_STOPS or rejected < MANY * used:
        return None
    return Finding(
        cause="tags-rejected",
        text=f"{rejected} of {rejected + used} tags that were read, at {len(at)} of {len(stops)} stops, do not lie "
        "where the box as described has them, and were left out: perhaps the box or its prints have another size or "
        "shape, or tags with the same ids hang elsewhere",
        advice="Compare the box with its target.json (measure-target), and put other prints of these tags away.",
        stops=at,
        size=100 * rejected / (rejected + used),
        unit="% of the tags read",
    )
