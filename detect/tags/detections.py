"""Detection of the target's tags and their corners in an image."""

from dataclasses import dataclass, field
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.detection import DetectorSettings
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.pyramid import Pyramid, align_coarsely
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.tag_patterns import family_patterns
from boxcal.detect.alignment.verification import Limits, verified
from boxcal.detect.errors import DetectError
from boxcal.detect.image.bit_depth import DeepGrey, eight_bits
from boxcal.detect.image.gray import LEAST_SIDE_PX, to_grey8, to_levels
from boxcal.detect.image.response_curve import Response, response_table
from boxcal.detect.tags.line_fit import CornerSettings, refine, systematic_px
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import Target
from boxcal.target.tags.families import dictionary_names, family_size, load_dictionary

_MIN_OTHER_TAGS = 4
_CELL_PX = 8
_THRESHOLD_CONSTANT = 3.0
"""OpenCV's own values, 4 and 7, find 8 % fewer of the tags of the real logs, at the same cost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TagSettings:
    """Settings of the detection of tags.

    Attributes
    ----------
    accurate
        Find all tags of the box and align each with its pattern (:mod:`boxcal.detect.alignment`). Otherwise OpenCV's
        detector finds tags one by one, and lines are fitted to their edges.
    response
        The camera's response curve of an accurate search: ``linear``, ``srgb``, or ``auto`` to tell it from the tags.
    threshold_windows_px
        Smallest and largest window, and their step, of the adaptive threshold that finds OpenCV's candidates.
    corners
        How lines are fitted, and under which response curve.
    """

    accurate: bool = True
    response: Response = "auto"
    threshold_windows_px: tuple[int, int, int] = (3, 23, 10)
    corners: CornerSettings = field(default_factory=CornerSettings)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TagDetections:
    """The target's tags in one image.

    Attributes
    ----------
    ids : (N,)
        Ascending, each once.
    corners_px : (N, 4, 2), px
        Top-left, top-right, bottom-right, bottom-left as the tag is drawn; pixel (0, 0) is the centre of the top-left
        pixel.
    sigma_px : (N,), px
        Standard deviation per axis of the corners' error that does not change from frame to frame of one place and that
        their covariance does not hold; zero where there is one.
    foreign_ids : (M,)
        Ids of the family that were seen but that the target does not carry, ascending; an accurate search looks for
        them only where it sees no tag of the target.
    cov_px2 : (N, 4, 2, 2), px^2, or None
        Covariance of each corner from this one image; None if lines were fitted.
    """

    ids: Ids
    corners_px: Array
    sigma_px: Array
    foreign_ids: Ids
    cov_px2: Array | None = None

    @classmethod
    def none(cls, foreign_ids: Ids | None = None) -> "TagDetections":
        """Return what an image without a tag of the target shows."""
        return cls(
            ids=np.zeros(0, dtype=np.int64),
            corners_px=np.zeros((0, 4, 2)),
            sigma_px=np.zeros(0),
            foreign_ids=np.zeros(0, dtype=np.int64) if foreign_ids is None else foreign_ids,
            cov_px2=np.zeros((0, 4, 2, 2)),
        )

    @property
    def landmark_ids(self) -> Ids:
        """Ids of all corners, (4 N,), ascending: ``4 * tag id + corner``."""
        return np.asarray((4 * self.ids[:, None] + np.arange(4)).ravel())


def find_tags(image: DeepGrey, target: Target, settings: TagSettings | None = None) -> TagDetections:
    """Return the target's tags in a grey image (H, W), uint8 or uint16 (white at 65535).

    A tag that shows up twice is dropped, both times unless the tags around it say which of them is on the box. A tag
    that does not look like its pattern, or does not lie where the box has it, is dropped too.

    Raises
    ------
    DetectError
        If the image is not grey.
    """
    if image.ndim != 2:
        raise DetectError(f"an image of shape {image.shape}: a grey one (H, W) is needed; convert it first")
    settings = settings or TagSettings()
    if settings.accurate and min(image.shape) >= LEAST_SIDE_PX:
        located = detect_tags(image, target, detector_settings(settings))
        if located.ids.size:
            return TagDetections(
                ids=located.ids,
                corners_px=located.corners_px,
                sigma_px=np.zeros(located.ids.size),
                foreign_ids=np.zeros(0, dtype=np.int64),
                cov_px2=located.cov_px2,
            )
        return TagDetections.none(foreign_tags(image, target, settings))
    grey = eight_bits(image)
    ids, corners = _detect(grey, target.box.dictionary, settings.threshold_windows_px)
    known = np.isin(ids, target.tag_ids)
    foreign = np.unique(ids[~known])
    ids, corners = ids[known], corners[known]
    unique, first, count = np.unique(ids, return_index=True, return_counts=True)
    ids, corners = unique[count == 1], corners[first[count == 1]]
    corners, good = refine(grey, corners, settings.corners)
    ids, corners = ids[good], corners[good]
    return TagDetections(ids=ids, corners_px=corners, sigma_px=systematic_px(corners), foreign_ids=foreign)


def foreign_tags(image: DeepGrey, target: Target, settings: TagSettings) -> Ids:
    """Return the ids of the target's family that a grey image (H, W) shows but the target does not carry, ascending."""
    ids, _ = _detect(to_grey8(image), target.box.dictionary, settings.threshold_windows_px)
    return np.unique(ids[~np.isin(ids, target.tag_ids)])


@cache
def detector_settings(settings: TagSettings) -> DetectorSettings:
    """Return the settings of the accurate detector."""
    return DetectorSettings(response=settings.response)


def other_family(image: NDArray[np.uint8], dictionary: str, settings: TagSettings | None = None) -> str | None:
    """Return the name of the tag family that the image shows, other than ``dictionary``; None if it shows none.

    Small families are contained in larger ones: of those that see most, the smallest is named. What OpenCV reads is
    not enough: version 4.10 forgives twelve of 36 bits of DICT_ARUCO_MIP_36h12, and of a thousand patterns of 16 bits
    one is found inside many a larger tag. So a tag counts that looks like its pattern throughout.
    """
    if min(image.shape) < LEAST_SIDE_PX:
        return None
    settings = settings or TagSettings()
    grey, _ = to_levels(image)
    height, width = grey.shape
    pyramid, limits = Pyramid(grey, response_table("linear"), no_distortion((width, height))), Limits().relaxed()
    best = (_MIN_OTHER_TAGS - 1, 0, "")
    for name in dictionary_names():
        if np.array_equal(load_dictionary(name).bytesList, load_dictionary(dictionary).bytesList):
            continue
        ids, corners = _detect(image, name, settings.threshold_windows_px)
        unique, rows = np.unique(ids, return_inverse=True)
        if unique.size < _MIN_OTHER_TAGS:
            continue
        patterns = family_patterns(name, unique)
        tags = align_coarsely(pyramid, patterns, rows, corners)
        count = np.unique(tags.rows[verified(patterns, tags, limits)]).size
        best = max(best, (count, -family_size(name), name))
    return best[2] or None


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
