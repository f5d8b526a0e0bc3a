"""Clock offset between camera and wheels, estimated from images that stay the same while the wheels stand still."""

import cv2
import numpy as np

from boxcal.detect.log.clocks import offset_by_standstills
from boxcal.detect.log.recording import Recording
from boxcal.target.arrays import Ids, Mask

_MOST_FRAMES = 3000
_SMALL_PX = (80, 60)
_LEAST_CONTRAST = 2.0
"""Images on the move must differ from frame to frame by so many times what they differ at rest."""


def clock_offset_by_pictures(recording: Recording, stands: Ids) -> int | None:
    """Return by how many ns the camera's clock is ahead of the wheels', None if the images do not determine it.

    Parameters
    ----------
    recording
        Its frames are read from first to last, small.
    stands : (P, 2) ns
        First and last time of each stand of the wheels.
    """
    step = -(-recording.frame_t_ns.size // _MOST_FRAMES)
    times: list[int] = []
    changes: list[float] = []
    before: cv2.typing.MatLike | None = None
    for t_ns, image in recording.read_frames(range(0, recording.frame_t_ns.size, step)):
        small = cv2.resize(image, _SMALL_PX, interpolation=cv2.INTER_AREA).astype(np.float32)
        if before is not None:
            changes.append(float(np.mean(np.abs(small - before))))
        times.append(t_ns)
        before = small
    if len(changes) < 3:
        return None
    still = _still(np.array(changes))
    return None if still is None else offset_by_standstills(np.array(times, dtype=np.int64), still, stands)


def _still(changes: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> Mask | None:
    """Return which changes from frame to frame are none; None if all are alike."""
    low, high = np.quantile(changes, (0.1, 0.9))
    low = max(float(low), 0.05)
    if high < _LEAST_CONTRAST * low:
        return None
    return np.asarray(changes < np.sqrt(low * high))
