"""Options of the estimator: unknowns, priors and known noise levels."""

from dataclasses import dataclass, field
from math import isfinite, radians

from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.explanation import Explanation
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraKind


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateOptions:
    """Unknowns beyond the basic ones, with the standard deviations of their priors; zero leaves an unknown out.

    Attributes
    ----------
    lens, optional
        Camera model; None lets the images choose.
    tilt_sigma : rad
        Tilt of the floor against the box' base, two angles a drive.
    rigid_floor
        Every stop stands on one plane exactly; else it leans and sinks a little, by how much the data say.
    scale_sigma, optional
        Print scale in x and y, relative: how much the sheets may be off their description. None lets the data say how
        well the target was made; 0 takes it as described. (This and the next ones count where ``target`` is given.)
    size_sigma : m
        The box' width and depth were measured to this; 0 if they were not.
    measured_sizes
        Whether the covariance of measured sizes counts, where ``target`` carries one.
    ink_sigma : m
        Dot gain: how far all edges of the tags' black lie outwards.
    growth_sigma : px
        Growth of the tags' black that is the same in all images: what the camera's response and sharpness do.
    face_sigma : (rad, m), optional
        Poses of the faces, rotation and translation. None lets the data say; zeros take them as described.
    bow_sigma : m, optional
        Outward sagitta of each face. None lets the data say; 0 takes them as flat.
    target
        The box as described; without it the landmarks are taken as exact.
    explanations
        What else is part of the model.
    encoder_step : rad, optional
        Found from the samples if None; 0 for readings without steps.
    slip : m/sqrt(m), optional
        Estimated if None.
    noise_scale : optional
        What the corners' standard deviations are multiplied by; estimated if None.
    systematic_share
        Size of smooth errors of corners that are alike in all images, in standard deviations of a corner's noise:
        what it adds to the covariance is in the sigmas. 0 where noise is known to be white, as in simulations.
        From robots of two renderers, ours and one that shares no code with it: with it the errors of the cameras are
        about as large as their sigmas say (``benchmarks/clean_robots.py``, ``benchmarks/rooms.py``).
    false_alarm
        Chance that a faultless drive has any leg, and again any corner, flagged.
    find_faults
        Whether legs and corners are tested and left out.
    """

    lens: CameraKind | None = CameraKind.RADIAL
    tilt_sigma: float = field(default=radians(1.0))
    rigid_floor: bool = False
    scale_sigma: float | None = None
    size_sigma: float = 0.0
    measured_sizes: bool = True
    ink_sigma: float = 1e-4
    growth_sigma: float = 0.02
    face_sigma: tuple[float, float] | None = None
    bow_sigma: float | None = None
    target: Target | None = None
    explanations: tuple[Explanation, ...] = ()
    encoder_step: float | None = None
    slip: float | None = None
    noise_scale: float | None = None
    systematic_share: float = 0.08
    false_alarm: float = 0.01
    find_faults: bool = True

    def __post_init__(self) -> None:
        numbers = {
            "tilt_sigma": self.tilt_sigma,
            "scale_sigma": self.scale_sigma,
            "size_sigma": self.size_sigma,
            "ink_sigma": self.ink_sigma,
            "growth_sigma": self.growth_sigma,
            "face_sigma (rotation)": self.face_sigma[0] if self.face_sigma else None,
            "face_sigma (translation)": self.face_sigma[1] if self.face_sigma else None,
            "bow_sigma": self.bow_sigma,
            "encoder_step": self.encoder_step,
            "slip": self.slip,
            "noise_scale": self.noise_scale,
            "systematic_share": self.systematic_share,
        }
        for name, value in numbers.items():
            if value is not None and not (isfinite(value) and value >= 0):
                raise CalibError(f"{name} is {value}: a finite number that is not negative is needed")
        if self.noise_scale == 0:
            raise CalibError("noise_scale is 0: a positive number is needed, or None to estimate it")
        if not 0 < self.false_alarm < 1:
            raise CalibError(f"false_alarm is {self.false_alarm}: a probability between 0 and 1 is needed")
