"""Which response curve the camera has: the largest tag is asked, others where it does not tell."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import LENS, PATTERNS, pose, truth, view

from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.image import response_curve
from boxcal.detect.image.gray import from_levels
from boxcal.detect.image.response_curve import TAGS, estimate_response, response_table
from boxcal.target.render.renderer import SensorModel


def _aligned(srgb):
    at = pose(25.0)
    frame = Frame(
        grey=from_levels(view(at, SensorModel(noise=2, psf_px=0.6, srgb=srgb))),
        response=response_table("linear"),
        lens=LENS,
    )
    uv, rows = truth(at)
    return frame, align(frame, PATTERNS, rows[:12], uv[rows[:12]])


@pytest.fixture
def asked(monkeypatch):
    """Return how many tags were aligned under each curve, one after the other."""
    counts = []
    monkeypatch.setattr(response_curve, "align", lambda *a, **k: counts.append(len(a[2])) or align(*a, **k))
    return counts


@pytest.mark.parametrize("srgb", [False, True])
def test_one_tag_that_tells_the_curve_clearly_is_enough(asked, srgb):
    frame, tags = _aligned(srgb)
    told = estimate_response(frame, PATTERNS, tags, "auto").imaging
    assert (told.response, told.settled) == ("srgb" if srgb else "linear", True)
    assert asked == [1, 1]


@pytest.mark.parametrize("srgb", [False, True])
def test_where_the_largest_tag_does_not_tell_others_are_asked(asked, monkeypatch, srgb):
    monkeypatch.setattr(response_curve, "CLEAR_ALONE", 0.0)
    frame, tags = _aligned(srgb)
    told = estimate_response(frame, PATTERNS, tags, "auto").imaging
    assert told.response == ("srgb" if srgb else "linear")
    assert asked == [1, 1, TAGS - 1, TAGS - 1]


def test_a_tag_with_large_residuals_does_not_outvote_the_others():
    _, tags = _aligned(srgb=False)
    some = replace(tags.take(np.arange(3)), correlation=np.full(3, 0.95))
    left = {
        "linear": replace(some, noise=np.array([0.01, 0.35, 0.01])),
        "srgb": replace(some, noise=np.array([0.05, 0.27, 0.05])),
    }
    assert response_curve._estimate(left).imaging.response == "linear"


def test_tags_that_do_not_fit_tell_nothing():
    _, tags = _aligned(srgb=False)
    left = {name: replace(tags, correlation=np.zeros(len(tags))) for name in ("srgb", "linear")}
    told = response_curve._estimate(left)
    assert told.darkness is None
    assert told.imaging.response in left
    assert not told.imaging.settled
