"""Maximum likelihood: the answer, its uncertainty, and what the drive does not tell."""

from calib.estimate.choose_lens import LensChoice as LensChoice
from calib.estimate.choose_lens import choose_lens as choose_lens
from calib.estimate.lens import Lens as Lens
from calib.estimate.options import EstimateOptions as EstimateOptions
from calib.estimate.result import Estimate as Estimate
from calib.estimate.run import estimate as estimate
