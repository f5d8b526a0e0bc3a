"""Noise of frames on the move: what a moving robot adds to that of stops."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.variance_components import USUAL
from boxcal.target.arrays import Array, Ids

GROWTH_PX = 0.02
"""Motion in an image makes its tags' black look larger or smaller by about this much besides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameNoise:
    """Variance components of frames on the move.

    Attributes
    ----------
    slip : m/sqrt(m)
        Of each wheel, spread along the path.
    jitter_s : s
        Standard deviation of a frame's own error in time.
    sway
        How much a moving robot leans and heaves beyond a standing one, in units of what stops usually do.
    scale
        Errors of corners over those at stops, for equal covariances.
    """

    slip: float
    jitter_s: float
    sway: float
    scale: float


def local_sigmas(components: VarianceComponents, noise: FrameNoise, count: int, moving: Ids) -> Array:
    """Return the standard deviations of each stop's and frame's local unknowns, (P, 4): rad, rad, m, px.

    Of several cameras each has its own growth, (P, 3 + C).

    Parameters
    ----------
    components
        Of the stops.
    noise
        Of the frames.
    count
        Stops and frames.
    moving : (F,)
        Which of them are frames.
    """
    at_rest = components.local_sigma
    usual = np.full(len(at_rest), GROWTH_PX)
    usual[:3] = noise.sway * np.array([USUAL["lean"], USUAL["lean"], USUAL["height"]])
    out = np.tile(at_rest, (count, 1))
    out[moving] = np.hypot(at_rest, usual)
    return out
