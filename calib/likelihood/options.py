"""What the estimator solves for, and what it is told beforehand."""

from dataclasses import dataclass, field
from math import isfinite, radians

from boxcal.calib.errors import CalibError
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraKind


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateOptions:
    """Unknowns beyond the basic ones, with the standard deviations of their priors; zero leaves an unknown out.

    Attributes
    ----------
    lens
        Lens model.
    tilt_sigma : rad
        Tilt of the floor against the box' base, two angles a drive.
    scale_sigma
        Print scale in x and y, relative: how much the sheets may be off their description (needs ``target``).
    size_sigma : m
        The box' width and depth likewise (needs ``target``). With the print scale this is what bounds the size of
        everything: no calibration is better than the box is known.
    measured_sizes
        Whether the covariance of measured sizes counts, where ``target`` carries one.
    ink_sigma : m
        Ink spread: how far all edges of the tags' black lie outwards (needs ``target``).
    face_sigma : (rad, m)
        Poses of faces 1 to 3 against face 0, rotation and translation (needs ``target``).
    target
        The box, where an option needs to know which face carries a landmark.
    encoder_step : rad, optional
        Found from the samples if None; 0 for readings without steps.
    slip : m/sqrt(m), optional
        Estimated if None.
    pixel_factor : optional
        What the corners' standard deviations are multiplied by; estimated if None.
    false_alarm
        Chance that a faultless drive has any leg, and again any corner, flagged.
    find_faults
        Whether legs and corners are tested and left out.
    """

    lens: CameraKind = CameraKind.RADIAL
    tilt_sigma: float = field(default=radians(1.0))
    scale_sigma: float = 0.0
    size_sigma: float = 0.0
    measured_sizes: bool = True
    ink_sigma: float = 0.0
    face_sigma: tuple[float, float] = (0.0, 0.0)
    target: Target | None = None
    encoder_step: float | None = None
    slip: float | None = None
    pixel_factor: float | None = None
    false_alarm: float = 0.01
    find_faults: bool = True

    def __post_init__(self) -> None:
        numbers = {
            "tilt_sigma": self.tilt_sigma,
            "scale_sigma": self.scale_sigma,
            "size_sigma": self.size_sigma,
            "ink_sigma": self.ink_sigma,
            "face_sigma (rotation)": self.face_sigma[0],
            "face_sigma (translation)": self.face_sigma[1],
            "encoder_step": self.encoder_step,
            "slip": self.slip,
            "pixel_factor": self.pixel_factor,
        }
        for name, value in numbers.items():
            if value is not None and not (isfinite(value) and value >= 0):
                raise CalibError(f"{name} is {value}: a finite number that is not negative is needed")
        if self.pixel_factor == 0:
            raise CalibError("pixel_factor is 0: a positive number is needed, or None to estimate it")
        if not 0 < self.false_alarm < 1:
            raise CalibError(f"false_alarm is {self.false_alarm}: a probability between 0 and 1 is needed")
        if (self.face_sigma[0] > 0) != (self.face_sigma[1] > 0):
            raise CalibError(f"face_sigma is {self.face_sigma}: both of its numbers positive, or both 0, are needed")
        if self.target is None and self.needs_target:
            raise CalibError("sizes of the box, ink spread and poses of faces need the box' description; give target")

    @property
    def needs_target(self) -> bool:
        """Whether an unknown of the box itself is asked for."""
        return self.scale_sigma > 0 or self.size_sigma > 0 or self.ink_sigma > 0 or self.face_sigma[1] > 0
