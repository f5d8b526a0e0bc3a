"""Frame taken on the move: what of the box it shows, and when it was taken."""

from dataclasses import dataclass, field

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.image.gray import MAX_SIDE_PX
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS

MAX_BOX_M = 100.0
"""No landmark lies further from the box's middle, m."""
FLAT_PX = 0.25
"""Corners whose mean distance (rms) from a line is less than this enclose no tag, px."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingFrame:
    """Landmarks seen in one frame that was taken while the robot moved.

    Attributes
    ----------
    t_ns : ns
        Stamp of the frame, on the wheels' clock as far as the stamps show.
    landmark_ids : (L,) int64
        ``4 * tag id + corner``, ascending, each once.
    p_box : (L, 3), m
        The landmarks in frame ``box``.
    faces : (L,)
        The face of the box that carries each landmark.
    uv_px : (L, 2), px
        Where they were seen; pixel (0, 0) is the centre of the top-left pixel.
    cov_px2 : (L, 2, 2), px^2
        Covariance of ``uv_px``.
    blur_px2 : (2, 2), px^2
        Covariance of the PSF, the usual one of its tags; 0 where it is not known.
    """

    t_ns: int
    landmark_ids: Ids
    p_box: Array
    faces: Ids
    uv_px: Array
    cov_px2: Array
    blur_px2: Array = field(default_factory=lambda: np.zeros((2, 2)))

    def __post_init__(self) -> None:
        refuse_odd_landmarks("a frame's", self.landmark_ids, (self.p_box, self.uv_px, self.cov_px2))
        if self.faces.shape != self.landmark_ids.shape:
            raise DetectError(f"a frame's landmarks: faces of shape {self.faces.shape}; (L,) needed")
        if self.blur_px2.shape != (2, 2) or not np.all(np.isfinite(self.blur_px2)):
            raise DetectError("a frame's blur is no covariance (2, 2) of finite numbers; leave it out")


def refuse_odd_landmarks(whose: str, landmark_ids: Ids, arrays: tuple[Array, Array, Array]) -> None:
    """Refuse landmarks whose places (box and image) and covariances do not fit together, or are no such things."""
    n = landmark_ids.shape[0]
    shapes = tuple(a.shape for a in arrays)
    if shapes != ((n, 3), (n, 2), (n, 2, 2)):
        raise DetectError(f"{whose} landmarks: found shapes {shapes} for {n} ids; (L, 3), (L, 2), (L, 2, 2) needed")
    if not np.issubdtype(landmark_ids.dtype, np.integer) or np.any(np.diff(landmark_ids, prepend=-1) <= 0):
        raise DetectError(f"{whose} landmarks: ids that do not ascend from 0 on, whole numbers; sort them")
    if not all(np.all(np.isfinite(a)) for a in arrays):
        raise DetectError(f"{whose} landmarks: a coordinate is not finite; drop such landmarks")
    p_box, _, cov_px2 = arrays
    if np.any(np.abs(p_box) > MAX_BOX_M):
        raise DetectError(f"{whose} landmarks: one lies more than {MAX_BOX_M:g} m from the box; they are in m")
    variances = cov_px2[:, [0, 1], [0, 1]]
    most = np.prod(np.sqrt(np.maximum(variances, 0.0)), axis=1)  # what an entry aside the diagonal stays below
    if np.any(variances > MAX_SIDE_PX**2):
        raise DetectError(f"{whose} landmarks: a standard deviation is beyond {MAX_SIDE_PX} px; drop such landmarks")
    if np.any(variances <= 0) or np.any(np.abs(cov_px2[:, [0, 1], [1, 0]]) >= most[:, None]):
        raise DetectError(f"{whose} landmarks: a covariance is not positive; drop such landmarks")


def refuse_corners_of_no_tag(whose: str, uv_px: Array, image_size: tuple[int, int]) -> None:
    """Refuse corners far outside their image, or all on one line of it: no detector finds such."""
    size = np.array(image_size)
    if np.any(uv_px < -size) or np.any(uv_px > 2 * size):
        raise DetectError(
            f"{whose} landmarks: a corner lies far outside the picture of {size[0]} x {size[1]} px; drop such landmarks"
        )
    if len(uv_px) >= CORNERS and _least_spread_px2(uv_px) < FLAT_PX**2:
        raise DetectError(f"{whose} landmarks: all lie on one line of the picture, as no tag's do; drop them")


def _least_spread_px2(uv_px: Array) -> float:
    """Return the mean squared distance of places (L, 2) from the line that is nearest to all."""
    off = uv_px - uv_px.mean(axis=0)
    (a, b), (_, d) = (off.T @ off / len(off)).tolist()
    return float((a + d) / 2 - np.hypot((a - d) / 2, b))
