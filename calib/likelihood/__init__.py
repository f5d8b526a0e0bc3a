"""Maximum likelihood: the answer, its uncertainty, and what the drive does not tell."""

from boxcal.calib.likelihood.estimate import Estimate as Estimate
from boxcal.calib.likelihood.estimator import estimate as estimate
from boxcal.calib.likelihood.options import EstimateOptions as EstimateOptions
from boxcal.target.camera.camera_model import CameraKind as CameraKind
