"""Score of a camera model on the images of a drive."""

from dataclasses import dataclass

from boxcal.target.camera.camera_model import CameraKind


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraScore:
    """Score of one camera model.

    Attributes
    ----------
    kind
        The model.
    coefficients
        How many it has beyond fu, fv, cu, cv.
    score
        Sum of squares more than the best model's, a charge for each coefficient included; the least is best.
    """

    kind: CameraKind
    coefficients: int
    score: float
