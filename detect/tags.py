"""Which tags of the target an image shows, and where their corners are."""

from dataclasses import dataclass, field
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.corners import CornerSettings, refine, systematic_px
from detect.errors import DetectError
from detect.wheels import Array, Ids
from target.box import Target
from target.patterns import dictionary_names, family_size, load_dictionary

_MIN_OTHER_TAGS = 4
_CELL_PX = 8
_THRESHOLD_CONSTANT = 3.0
"""OpenCV's own values, 4 and 7, find 8 % fewer of the tags of the real logs, at the same cost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TagSettings:
    """How tags are found.

    Attributes
    ----------
    threshold_windows_px
        Smallest and largest window, and their step, of the adaptive threshold that finds candidates.
    corners
        How their corners are refined.
    """

    threshold_windows_px: tuple[int, int, int] = (3, 23, 10)
    corners: CornerSettings = field(default_factory=CornerSettings)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tags:
    """The target's tags in one image.

    Attributes
    ----------
    ids : (N,)
        Ascending, each once.
    corners_px : (N, 4, 2), px
        Top-left, top-right, bottom-right, bottom-left as the tag is drawn; pixel (0, 0) is the centre of the top-left
        pixel.
    sigma_px : (N,), px
        Standard deviation per axis of the corners' error that does not change from frame to frame of one place.
    foreign_ids : (M,)
        Ids of the family that were seen but that the target does not carry, ascending.
    """

    ids: Ids
    corners_px: Array
    sigma_px: Array
    foreign_ids: Ids

    @property
    def landmark_ids(self) -> Ids:
        """Ids of all corners, (4 N,), ascending: ``4 * tag id + corner``."""
        return np.asarray((4 * self.ids[:, None] + np.arange(4)).ravel())


def find_tags(image: NDArray[np.uint8], target: Target, settings: TagSettings | None = None) -> Tags:
    """Return the target's tags in a grey image (H, W).

    A tag that shows up twice is dropped both times: one of them is not on the box. A tag whose edges do not lie where
    its square was found is dropped too.

    Raises
    ------
    DetectError
        If the image is not grey.
    """
    if image.ndim != 2:
        raise DetectError(f"an image of shape {image.shape}: a grey one (H, W) is needed; convert it first")
    settings = settings or TagSettings()
    ids, corners = _detect(image, target.box.dictionary, settings.threshold_windows_px)
    known = np.isin(ids, target.tag_ids)
    foreign = np.unique(ids[~known])
    ids, corners = ids[known], corners[known]
    unique, first, count = np.unique(ids, return_index=True, return_counts=True)
    ids, corners = unique[count == 1], corners[first[count == 1]]
    corners, good = refine(image, corners, settings.corners)
    ids, corners = ids[good], corners[good]
    return Tags(ids=ids, corners_px=corners, sigma_px=systematic_px(corners), foreign_ids=foreign)


def other_family(image: NDArray[np.uint8], dictionary: str, settings: TagSettings | None = None) -> str | None:
    """Return the name of the tag family that the image shows, other than ``dictionary``; None if it shows none.

    Small families are contained in larger ones: of those that see most, the smallest is named.
    """
    settings = settings or TagSettings()
    seen = [
        (np.unique(_detect(image, name, settings.threshold_windows_px)[0]).size, -family_size(name), name)
        for name in dictionary_names()
        if not np.array_equal(load_dictionary(name).bytesList, load_dictionary(dictionary).bytesList)
    ]
    count, _, name = max(seen)
    return name if count >= _MIN_OTHER_TAGS else None


def _detect(image: NDArray[np.uint8], dictionary: str, windows_px: tuple[int, int, int]) -> tuple[Ids, Array]:
    """Return ids (N,) and rough corners (N, 4, 2); an id may stand there twice."""
    corners, ids, _ = _detector(dictionary, windows_px).detectMarkers(image)
    if ids is None or len(ids) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    return np.ravel(ids).astype(np.int64), np.array(corners, dtype=np.float64).reshape(-1, 4, 2)


@cache
def _detector(dictionary: str, windows_px: tuple[int, int, int]) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.perspectiveRemovePixelPerCell = _CELL_PX
    parameters.adaptiveThreshConstant = _THRESHOLD_CONSTANT
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax, parameters.adaptiveThreshWinSizeStep = (
        windows_px
    )
    return cv2.aruco.ArucoDetector(load_dictionary(dictionary), parameters)
