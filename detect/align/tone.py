"""The camera's tone curve: grey levels from light, known or told from the tags themselves.

A lens mixes light, the curve comes after: under sRGB a blurred edge is no longer symmetric, bright borders bloom and
tags seem to shrink. The wrong curve leaves larger residuals at every edge; that tells which one the camera has.
"""

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np

from detect.align.model import GAIN, OFFSET, SLOPE_X, SLOPE_Y, Frame
from detect.align.pattern import Array, Patterns
from detect.align.solve import Aligned, align
from detect.errors import DetectError

Tone = Literal["auto", "linear", "srgb"]
TONES: tuple[Tone, ...] = ("auto", "linear", "srgb")
TAGS = 4
_ENTRIES = 1025


@cache
def tone_table(tone: str) -> Array:
    """Return grey levels 0..1 of light 0..1 in even steps: two entries for ``linear``, IEC 61966-2-1 for ``srgb``."""
    if tone == "linear":
        return np.array([0.0, 1.0])
    if tone == "srgb":
        light = np.linspace(0, 1, _ENTRIES)
        high = 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055
        return np.asarray(np.where(light <= 0.0031308, 12.92 * light, high))
    raise DetectError(f"tone is {tone!r}, one of linear, srgb is needed")


def relit(tags: Aligned, old: Array, new: Array) -> Aligned:
    """Return tags aligned under one tone curve as a start under another: the light of white and black exchanged."""
    offset, gain = tags.theta[:, OFFSET], tags.theta[:, GAIN]
    levels = [np.interp(light, np.linspace(0, 1, len(old)), old) for light in (offset, offset + gain)]
    black, white = (np.interp(level, new, np.linspace(0, 1, len(new))) for level in levels)
    theta = tags.theta.copy()
    theta[:, OFFSET], theta[:, GAIN] = black, np.maximum(white - black, 1e-3)
    theta[:, SLOPE_X : SLOPE_Y + 1] *= (theta[:, GAIN] / np.maximum(gain, 1e-3))[:, None]
    return replace(tags, theta=theta, offset=black, gain=theta[:, GAIN])


def choose_tone(frame: Frame, patterns: Patterns, tags: Aligned) -> str:
    """Return the tone curve under which tags, aligned roughly under any, leave the smaller residuals.

    A few of the largest tags are asked; ``linear`` where neither is clearly better, as then it makes no difference.
    """
    size = np.linalg.norm(tags.corners_px[:, 2] - tags.corners_px[:, 0], axis=1)
    some = tags.take(np.argsort(-size)[:TAGS])
    left = {}
    for tone in ("linear", "srgb"):
        under = Frame(grey=frame.grey, tone=tone_table(tone), lens=frame.lens)
        start = relit(some, frame.tone, under.tone)
        left[tone] = align(under, patterns, some.rows, some.corners_px, start=start, relight=True, side_px=24.0)
    fitted = np.minimum(left["linear"].correlation, left["srgb"].correlation) > 0.8
    linear, srgb = (float(np.sum(left[t].noise[fitted] ** 2)) for t in ("linear", "srgb"))
    return "srgb" if srgb < 0.97 * linear else "linear"
