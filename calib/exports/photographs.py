"""Small photographs of the stops, for the report: one frame each, bounded in size and number."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2

from boxcal.calib.exports.stop_images import opened, stop_frame
from boxcal.calib.results.stop_residuals import SeenStop
from boxcal.calib.settings import CORRESPONDENCES
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.extract import Pictures
from boxcal.detect.image.bit_depth import DeepGrey, eight_bits
from boxcal.detect.log.images import Grey
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import WheelUnits

MOST = 24
"""Photographs of one robot; of more stops those that fit worst are taken."""
_SIDE_PX, _QUALITY = 560, 55
_MOST_KEPT = 60
"""Photographs kept while a log is read: of longer drives the few that the report shows are read again."""


def photographs(
    logs: Sequence[Path],
    seen: Sequence[SeenStop],
    drives: Sequence[Correspondences],
    *,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    kept: Sequence[Mapping[int, bytes]] = (),
) -> dict[str, bytes]:
    """Return a JPEG by the label of its stop, some 20 kB each; none where correspondences were saved before.

    A log is opened only for stops of which none was kept when it was read.

    Parameters
    ----------
    logs
        The robot's recordings.
    seen
        Its stops.
    drives
        What was extracted from each log.
    topics, units
        As the logs were read with.
    kept
        Of each log, photographs by the time (ns) at which their stops began.

    Raises
    ------
    DetectError
        If a log cannot be read.
    """
    worst = sorted(seen, key=lambda s: -s.result.reprojection_rms_px)[:MOST]
    chosen = [s for s in seen if any(s is w for w in worst)]
    found: dict[str, bytes] = {}
    for d, log in enumerate(logs):
        mine = [s for s in chosen if s.drive == d]
        known = kept[d] if d < len(kept) else {}
        found |= {s.label: known[s.view.t_start_ns] for s in mine if s.view.t_start_ns in known}
        mine = [s for s in mine if s.label not in found]
        if log.suffix == CORRESPONDENCES or not mine:
            continue
        recording = opened(log, topics, units, drives[d])
        for s in mine:
            frame = stop_frame(recording, s.view.t_start_ns, s.view.t_end_ns)
            if frame is not None:
                found[s.label] = small_jpeg(frame[1])
    return found


def keeping(photos: dict[int, bytes]) -> Pictures:
    """Return what keeps small photographs of stops while a log is read, by the time (ns) at which each stop began."""

    def keep(t_ns: int, frame: DeepGrey) -> None:
        if len(photos) < _MOST_KEPT:
            photos[t_ns] = small_jpeg(eight_bits(frame))

    return keep


def small_jpeg(image: Grey) -> bytes:
    """Return an image as a JPEG whose longer side has at most 560 pixels."""
    k = min(1.0, _SIDE_PX / max(image.shape[:2]))
    size = [max(1, round(k * side)) for side in image.shape[1::-1]]
    whole = [max(1, side // int(1 / k)) for side in image.shape[1::-1]]
    # areas of whole pixels, which are fast; what is left to shrink needs none
    halved = image if k > 0.5 else cv2.resize(image, whole, interpolation=cv2.INTER_AREA)
    small = image if k == 1.0 else cv2.resize(halved, size, interpolation=cv2.INTER_LINEAR)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
