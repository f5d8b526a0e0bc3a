"""The camera response function: grey levels from linear intensity, known or estimated from the tags.

A lens mixes light, the curve comes after: under sRGB a blurred edge is no longer symmetric, bright borders bloom and
tags seem to shrink. The wrong curve leaves larger residuals at every edge, which shows which one the camera has.
"""

from dataclasses import dataclass, replace
from functools import cache
from math import exp
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.parameters import BLACK, CONTRAST, GRADIENT_X, GRADIENT_Y, KURTOSIS
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.detect.errors import DetectError
from boxcal.detect.image.order_statistics import median
from boxcal.target.arrays import Array
from boxcal.target.render.srgb import srgb_from_linear

Response = Literal["auto", "linear", "srgb"]
RESPONSES: tuple[Response, ...] = ("auto", "linear", "srgb")
TAGS = 3
SIDE_PX, STOP_PX = 16.0, 0.1
CLEAR, CLEAR_ALONE = 0.8, 0.5
"""A response curve that leaves this fraction of the other's squared residuals is the camera's; of one tag's, so clearly
that no other need be asked."""
FITTED = 0.8
"""Least correlation of a tag from which the curve is estimated."""
_ENTRIES, _TINY = 1025, 1e-9


@cache
def response_table(response: str) -> Array:
    """Return grey levels 0..1 of light 0..1 in even steps: two entries for ``linear``, IEC 61966-2-1 for ``srgb``."""
    if response == "linear":
        return np.array([0.0, 1.0])
    if response == "srgb":
        return np.asarray(srgb_from_linear(np.linspace(0, 1, _ENTRIES)), dtype=np.float64)
    raise DetectError(f"tone is {response!r}, one of linear, srgb is needed")


@cache
def _lights(entries: int) -> Array:
    """Return the light 0..1 of the entries of a table."""
    return np.linspace(0, 1, entries)


def with_response(tags: TagAlignments, old: Array, new: Array) -> TagAlignments:
    """Return tags aligned under one response curve as a start under another: the light of white and black exchanged."""
    if new is old:
        return tags
    offset, gain = tags.theta[:, BLACK], tags.theta[:, CONTRAST]
    levels = [np.interp(light, _lights(len(old)), old) for light in (offset, offset + gain)]
    black, white = (np.interp(level, new, _lights(len(new))) for level in levels)
    theta = tags.theta.copy()
    theta[:, BLACK], theta[:, CONTRAST] = black, np.maximum(white - black, 1e-3)
    theta[:, GRADIENT_X : GRADIENT_Y + 1] *= (theta[:, CONTRAST] / np.maximum(gain, 1e-3))[:, None]
    return replace(tags, theta=theta, black_level=black, contrast=theta[:, CONTRAST])


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagingParameters:
    """Imaging parameters that all tags of an image share.

    Attributes
    ----------
    response
        Response curve, ``linear`` or ``srgb``.
    kurtosis
        Excess kurtosis of the blur.
    settled
        Whether the response curve was given, or is clearly determined.
    """

    response: str
    kurtosis: float
    settled: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseEstimate:
    """Imaging parameters and darkness of black, estimated from a few tags.

    Attributes
    ----------
    imaging
        The response curve and the PSF's kurtosis.
    darkness
        Light of tags' black over that of white. Roughly aligned tags determine it badly where white blooms into black
        and the curve is steep there; on a box all are printed alike.
    """

    imaging: ImagingParameters
    darkness: float | None


def estimate_response(frame: Frame, patterns: Patterns, tags: TagAlignments, response: Response) -> ResponseEstimate:
    """Return the response curve under which roughly aligned tags leave the smallest residuals, and the PSF's kurtosis.

    The largest tag is asked, about both curves or the given one, and a few others too where it does not say clearly;
    the answer is ``linear`` where neither is clearly better, as then it makes no difference.
    """
    diagonal = tags.corners_px[:, 2] - tags.corners_px[:, 0]
    largest = np.argsort(-np.hypot(diagonal[:, 0], diagonal[:, 1]))[:TAGS]
    names: tuple[str, ...] = ("linear", "srgb") if response == "auto" else (response,)
    left = {name: _aligned_under(name, frame, patterns, tags.take(largest[:1])) for name in names}
    fitted, residual = _residuals(left)
    if len(largest) > 1 and not (fitted.any() and min(residual.values()) <= CLEAR_ALONE * max(residual.values())):
        others = tags.take(largest[1:])
        left = {name: one.joined(_aligned_under(name, frame, patterns, others)) for name, one in left.items()}
    return _estimate(left)


def _aligned_under(response: str, frame: Frame, patterns: Patterns, tags: TagAlignments) -> TagAlignments:
    """Return roughly aligned tags aligned under a response curve, on few pixels."""
    under = Frame(grey=frame.grey, response=response_table(response), lens=frame.lens)
    return align(
        under,
        patterns,
        tags.rows,
        tags.corners_px,
        start=with_response(tags, frame.response, under.response),
        intensity_unknown=True,
        side_px=SIDE_PX,
        stop_px=STOP_PX,
        covariance=False,
        thinned=True,
    )


def _residuals(left: dict[str, TagAlignments]) -> tuple[NDArray[np.bool_], dict[str, float]]:
    """Return which tags (N,) fit under all of some response curves, and what squared residuals those leave.

    Their geometric mean: where a shadow's edge or a finger crosses one tag, its own are far larger than all others'.
    """
    fitted = np.min([tags.correlation for tags in left.values()], axis=0) > FITTED
    if not fitted.any():
        return fitted, dict.fromkeys(left, 0.0)
    return fitted, {name: exp(2 * np.log(tags.noise[fitted] + _TINY).mean()) for name, tags in left.items()}


def _estimate(left: dict[str, TagAlignments]) -> ResponseEstimate:
    """Return the estimate from tags that were aligned under each of some response curves."""
    fitted, residual = _residuals(left)
    best = min(left, key=lambda name: residual[name] * (1.0 if name == "linear" else 1.03))
    estimates = left[best].theta[fitted]
    imaging = ImagingParameters(
        response=best,
        kurtosis=median(estimates[:, KURTOSIS]) if len(estimates) else 0.0,
        settled=len(left) == 1 or (len(estimates) > 0 and min(residual.values()) <= CLEAR * max(residual.values())),
    )
    darkness = estimates[:, BLACK] / (estimates[:, BLACK] + estimates[:, CONTRAST])
    return ResponseEstimate(imaging=imaging, darkness=median(darkness) if len(estimates) else None)
