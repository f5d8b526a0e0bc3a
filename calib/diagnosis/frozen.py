"""Images that stay the same while the robot drives: a camera driver that repeats its last frame."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.diagnosis.left_out import numbers, without_stops
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences, StopObservation

SAME_PX = 0.02
"""Two stops show one image if no corner differs by more: noise alone makes two images differ by that."""
MOVED_RAD = 0.2
"""And if a wheel turned by more than this between them."""


def frozen_stops(stops: Sequence[StopObservation]) -> tuple[int, ...]:
    """Return the stops, from 0, whose image is that of the stop before although the wheels turned."""
    return tuple(j for j in range(1, len(stops)) if _same(stops[j - 1], stops[j]) and _moved(stops[j - 1], stops[j]))


def without_frozen(drive: Correspondences) -> tuple[Correspondences, Finding | None]:
    """Return a drive without the corners of images that are older ones, and what is said of them; None if none are.

    The stops stay, so that all stops keep their numbers; a stop without corners is not used.
    """
    frozen = frozen_stops(drive.stops)
    if not frozen:
        return drive, None
    finding = Finding(
        cause="pictures-frozen",
        text="the camera's picture does not change while the wheels turn "
        f"(stops {numbers(frozen)} of {len(drive.stops)} show the picture of the stop before): these stops were left "
        "out",
        advice="Look for a camera driver that hangs and repeats its last frame, and for wheels that turn on the spot.",
        adopted=True,
        stops=frozen,
    )
    return without_stops(drive, frozen), finding


def _same(a: StopObservation, b: StopObservation) -> bool:
    if not len(a.landmark_ids) or not np.array_equal(a.landmark_ids, b.landmark_ids):
        return False
    return bool(np.all(np.abs(a.uv_px - b.uv_px) < SAME_PX))


def _moved(a: StopObservation, b: StopObservation) -> bool:
    return max(abs(b.phi_R - a.phi_R), abs(b.phi_L - a.phi_L)) > MOVED_RAD
