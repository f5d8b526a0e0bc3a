"""The camera response function: grey levels from linear intensity, known or estimated from the tags.

A lens mixes light, the curve comes after: under sRGB a blurred edge is no longer symmetric, bright borders bloom and
tags seem to shrink. The wrong curve leaves larger residuals at every edge; that tells which one the camera has.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np

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
CLEAR = 0.8
"""A response curve that leaves this fraction of the other's squared residuals is the camera's."""
_ENTRIES = 1025


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
    """Imaging parameters that all tags of a picture share.

    Attributes
    ----------
    response
        Response curve, ``linear`` or ``srgb``.
    kurtosis
        Excess kurtosis of the blur.
    settled
        Whether the response curve was given, or told clearly.
    """

    response: str
    kurtosis: float
    settled: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseEstimate:
    """Imaging parameters and darkness of black, as a few tags tell them.

    Attributes
    ----------
    imaging
        The response curve and the PSF's kurtosis.
    darkness
        Light of tags' black over that of white. Roughly aligned tags tell it badly where white blooms into black and
        the curve is steep there; on a box all are printed alike.
    """

    imaging: ImagingParameters
    darkness: float | None


def estimate_response(frame: Frame, patterns: Patterns, tags: TagAlignments, response: Response) -> ResponseEstimate:
    """Return the response curve under which roughly aligned tags leave the smallest residuals, and the PSF's kurtosis.

    A few of the largest tags are asked, about both curves or the given one; the answer is ``linear`` where neither is
    clearly better, as then it makes no difference.
    """
    diagonal = tags.corners_px[:, 2] - tags.corners_px[:, 0]
    some = tags.take(np.argsort(-np.hypot(diagonal[:, 0], diagonal[:, 1]))[:TAGS])
    left = {}
    for name in ("linear", "srgb") if response == "auto" else (response,):
        under = Frame(grey=frame.grey, response=response_table(name), lens=frame.lens)
        start = with_response(some, frame.response, under.response)
        left[name] = align(
            under,
            patterns,
            some.rows,
            some.corners_px,
            start=start,
            intensity_unknown=True,
            side_px=SIDE_PX,
            stop_px=STOP_PX,
            covariance=False,
            thinned=True,
        )
    fitted = np.min([tags.correlation for tags in left.values()], axis=0) > 0.8
    residual = {name: float(np.sum(tags.noise[fitted] ** 2)) for name, tags in left.items()}
    best = min(left, key=lambda name: residual[name] * (1.0 if name == "linear" else 1.03))
    told = left[best].theta[fitted]
    imaging = ImagingParameters(
        response=best,
        kurtosis=median(told[:, KURTOSIS]) if len(told) else 0.0,
        settled=min(residual.values()) <= CLEAR * max(residual.values()) or len(left) == 1,
    )
    darkness = told[:, BLACK] / (told[:, BLACK] + told[:, CONTRAST])
    return ResponseEstimate(imaging=imaging, darkness=median(darkness) if len(told) else None)
