"""Frame taken on the move: what of the box it shows, and when it was taken."""

from dataclasses import dataclass

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.target.arrays import Array, Ids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingFrame:
    """Landmarks seen in one frame that was taken while the robot moved.

    Attributes
    ----------
    t_ns : ns
        Stamp of the frame, on the wheels' clock as far as stamps tell.
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
    """

    t_ns: int
    landmark_ids: Ids
    p_box: Array
    faces: Ids
    uv_px: Array
    cov_px2: Array

    def __post_init__(self) -> None:
        refuse_odd_landmarks("a frame's", self.landmark_ids, (self.p_box, self.uv_px, self.cov_px2))
        if self.faces.shape != self.landmark_ids.shape:
            raise DetectError(f"a frame's landmarks: faces of shape {self.faces.shape}; (L,) needed")


def refuse_odd_landmarks(whose: str, landmark_ids: Ids, arrays: tuple[Array, Array, Array]) -> None:
    """Refuse landmarks whose places (box and image) and covariances do not fit together or are not finite."""
    n = landmark_ids.shape[0]
    shapes = tuple(a.shape for a in arrays)
    if shapes != ((n, 3), (n, 2), (n, 2, 2)):
        raise DetectError(f"{whose} landmarks: found shapes {shapes} for {n} ids; (L, 3), (L, 2), (L, 2, 2) needed")
    if not all(np.all(np.isfinite(a)) for a in arrays):
        raise DetectError(f"{whose} landmarks: a coordinate is not finite; drop such landmarks")
