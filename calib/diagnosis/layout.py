"""Check of tag size against tag spacing, which recognises another box's prints."""

from collections.abc import Sequence

import cv2
import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import StopObservation
from boxcal.target.arrays import Array
from boxcal.target.box import CORNERS, FACES, Target

LEAST_SHARE = 0.02
"""Tags are this much too large or too small for their spacing before they are taken for another box's."""
LEAST_GAIN = 3.0
"""Factor by which that must shrink what a plane's view leaves of the corners."""
_SCALES = np.linspace(0.6, 1.6, 101)
_TAGS = 6


def other_layout(stops: Sequence[StopObservation], target: Target) -> Finding | None:
    """Return what is said of prints of another box with equal tags; None if the prints are the box's.

    One sheet in one image is a plane: its corners follow a homography whatever the camera, but for the lens. Tags of
    another size at the same spacing, or the same tags at another, do not.
    """
    sheets = [view for stop in stops for view in _sheets(stop, target)]
    if not sheets:
        return None
    cost = np.array([np.mean([_misfit(view, scale) for view in sheets]) for scale in _SCALES])
    best = int(np.argmin(cost))
    scale, described = float(_SCALES[best]), float(cost[int(np.argmin(np.abs(_SCALES - 1)))])
    if abs(scale - 1) < LEAST_SHARE or described < LEAST_GAIN**2 * cost[best]:
        return None
    size = "large" if scale > 1 else "small"
    return Finding(
        cause="other-box",
        text=f"the tags are {abs(scale - 1):.0%} too {size} for their spacing: this is another box with equal ids "
        f"(corners of one sheet miss a plane's view by {np.sqrt(described):.1f} px as described, by "
        f"{np.sqrt(cost[best]):.1f} px so)",
        advice="Give the target.json that this box was printed from with --target.",
        blocks=True,
        size=scale,
        unit="of the tags' size as described",
    )


def _sheets(stop: StopObservation, target: Target) -> list[tuple[Array, Array, Array]]:
    """Return the tags' centres and corners about them in the sheet's plane, (L, 2) m each, and pixels (L, 2)."""
    rows = np.array([target.row_of(int(i) // CORNERS) for i in stop.landmark_ids], dtype=np.int64)
    out = []
    for sheet in range(FACES):
        on = np.flatnonzero(target.tag_faces[rows] == sheet)
        if len(on) < _TAGS * CORNERS:
            continue
        T = inverse(target.T_box_face(sheet))
        p = target.tag_corners[rows[on]] @ T[:3, :3].T + T[:3, 3]
        centre = p.mean(axis=1)[:, :2]
        corner = p[np.arange(len(on)), stop.landmark_ids[on] % CORNERS, :2]
        out.append((centre, corner - centre, stop.uv_px[on]))
    return out


def _misfit(view: tuple[Array, Array, Array], scale: float) -> float:
    """Return the mean square, px^2, by which a sheet misses a homography if its tags are larger by a factor."""
    centre, corner, uv_px = view
    p = centre + scale * corner
    H, _ = cv2.findHomography(p, uv_px)
    q = np.column_stack([p, np.ones(len(p))]) @ H.T
    return float(np.mean(np.sum((q[:, :2] / q[:, 2:] - uv_px) ** 2, axis=1)))
