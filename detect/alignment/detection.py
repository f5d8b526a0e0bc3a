"""The detector's settings, its output, and what it hands on from image to image."""

from dataclasses import dataclass, field

import numpy as np

from boxcal.detect.alignment.box_pose import CameraPrior
from boxcal.detect.alignment.tag_patterns import Index
from boxcal.detect.alignment.verification import Limits
from boxcal.detect.errors import DetectError
from boxcal.detect.image.response_curve import RESPONSES, ImagingParameters, Response
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorSettings:
    """Settings of the tag detector.

    Attributes
    ----------
    response
        The camera response function: ``linear``, ``srgb``, or ``auto`` to tell it from the tags.
    fast
        Preview: only tags that stand out, their edges fitted with lines.
    limits
        What an aligned tag must keep to.
    windows_px
        Neighbourhoods that tell dark from bright: the first one always, the others where it finds few tags.
    """

    response: Response = "auto"
    fast: bool = False
    limits: Limits = field(default_factory=Limits)
    windows_px: tuple[int, ...] = (25, 9)

    def __post_init__(self) -> None:
        if self.response not in RESPONSES:
            raise DetectError(f"tone is {self.response!r}, one of {', '.join(RESPONSES)} is needed")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownCamera:
    """Knowledge from earlier images of a camera that speeds up the next one.

    Attributes
    ----------
    prior
        Focal length and distortion.
    imaging
        Response curve and kurtosis of the PSF.
    round_inflation
        Largest variance inflation at which the blur of an image was found to be round; 0 where that was never asked.
    """

    prior: CameraPrior
    imaging: ImagingParameters
    round_inflation: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectorOutput:
    """Tags located in one image.

    Attributes
    ----------
    ids : (N,)
        Ascending, each once.
    corners_px : (N, 4, 2), px
        Top-left, top-right, bottom-right, bottom-left as the tag is drawn; pixel (0, 0) is the centre of the top-left
        pixel.
    cov_px2 : (N, 4, 2, 2), px^2
        Covariance of each corner: noise as the residuals have it, and the model's own error.
    correlation : (N,)
        Of the image with the aligned pattern; NaN in a preview.
    blur_px : (N,), px
        Deviation of blur and pixel area together; NaN in a preview.
    blur_shape : (2,)
        How much the image is blurred along its motion: c and s of :mod:`boxcal.detect.alignment.motion_blur`.
    residual : (N,)
        Deviation of the grey levels from the aligned pattern, 1 is full scale; NaN in a preview.
    response
        The response curve that was used.
    camera
        For the next image of the same camera; None where too little was seen, and in a preview.
    contradicting_faces
        Faces of which tags are seen where the box that was found cannot have them: on another box, or on a print.
    rejected_ids : (R,)
        Tags that were read, but nowhere near where the box has them, ascending.
    """

    ids: Index
    corners_px: Array
    cov_px2: Array
    correlation: Array
    blur_px: Array
    residual: Array
    response: str
    camera: KnownCamera | None = None
    blur_shape: Array = field(default_factory=lambda: np.zeros(2))
    contradicting_faces: tuple[int, ...] = ()
    rejected_ids: Index = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def nothing(response: str) -> DetectorOutput:
    """Return what is located where there is no tag."""
    none = np.zeros(0)
    return DetectorOutput(
        ids=np.zeros(0, dtype=np.int64),
        corners_px=np.zeros((0, 4, 2)),
        cov_px2=np.zeros((0, 4, 2, 2)),
        correlation=none,
        blur_px=none,
        residual=none,
        response=response,
    )
