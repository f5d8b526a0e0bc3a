"""Size of the prints, estimated from images in which the tags of two faces do not fit one box as described.

One face says nothing of its size: it looks as if it were nearer. Two faces of a box whose prints came out smaller lie
further apart than their tags say; where that is too much for the search, it sees one of them only. The search is tried
with prints of other sizes on the same box.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from boxcal.detect.alignment.detector import detect_in_grey
from boxcal.detect.image.bit_depth import FULL_SCALE, DeepGrey
from boxcal.detect.image.gray import LEAST_SIDE_PX, eight_bit_copy
from boxcal.detect.tags.detections import TagSettings, detector_settings
from boxcal.target.box import FACES, Target

SCALES = (0.97, 1.03, 0.94, 1.06, 0.91, 1.09, 0.88, 1.12, 0.85, 1.15, 0.82, 1.18)
"""Sizes that are tried, near ones first; the search follows a print that is off by 3 %, and A4 on Letter is 0.94."""
MORE = 1.2
"""A size is believed under which so many times as many tags lie on the box."""
ODD = 5e-3
"""Prints that differ more in size, relative, are none of one printing."""


def scaled_prints(target: Target, scale: float | Sequence[float]) -> Target:
    """Return a box whose prints, or those of its faces (FACES,), are larger by a factor about the middle of a face."""
    corners = target.tag_corners.copy()
    for face, size in enumerate(np.broadcast_to(scale, FACES).tolist()):
        on = target.tag_faces == face
        middle = target.T_box_face(face)[:3, 3]
        corners[on] = middle + size * (corners[on] - middle)
    return replace(target, tag_corners=corners)


def print_scale(image: DeepGrey, target: Target, settings: TagSettings) -> float:
    """Return the size of the prints against their description under which clearly more tags lie on the box, else 1.

    Parameters
    ----------
    image : (H, W)
        Grey image, uint8 or uint16 (white at 65535), in which tags were read that do not fit the box.
    target, settings
        The box as described, and how tags are found.
    """
    if not settings.accurate or min(image.shape) < LEAST_SIDE_PX:
        return 1.0
    full = 255.0 if image.dtype == np.uint8 else float(FULL_SCALE)
    picture = image.astype(np.float32)
    grey, grey8 = np.multiply(picture, np.float32(1 / full), dtype=np.float32), eight_bit_copy(picture, full)

    def tags(scale: float) -> int:
        return len(detect_in_grey(grey, grey8, scaled_prints(target, scale), detector_settings(settings)).ids)

    counts = {scale: tags(scale) for scale in SCALES}
    best = max(counts, key=lambda scale: counts[scale])
    return best if counts[best] >= MORE * tags(1.0) else 1.0


def print_sizes(target: Target, built: Target) -> tuple[float, ...]:
    """Return the sizes (FACES,) of the faces' prints on a box as built, over that of most; empty if they are alike."""
    side, described = (np.linalg.norm(t.tag_corners[:, 2] - t.tag_corners[:, 0], axis=1) for t in (built, target))
    by_face = np.array([np.mean((side / described)[target.tag_faces == face]) for face in range(FACES)])
    sizes = by_face / np.median(by_face)
    return tuple(sizes.tolist()) if np.abs(sizes - 1).max() > ODD else ()
