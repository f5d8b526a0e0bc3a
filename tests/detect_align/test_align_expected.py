"""Tags are found where they are expected, and wherever else they are if they are not there."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import PATTERNS, PLAIN, TARGET, pose, truth, view

from boxcal.detect.alignment import box_growth, detector, expected_tags
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.expected_tags import ExpectedTags
from boxcal.detect.alignment.pyramid import align_coarsely
from boxcal.detect.alignment.pyramid_search import find_box
from boxcal.detect.alignment.resemblance import resemblance

POSE = pose(28.0, distance=0.55)
MODULE_PX = 3.2
"""Of the tags in that view, about."""


@pytest.fixture
def seen(monkeypatch):
    """Return the tags of a view as a search of the whole picture finds them, and how often such a search is made."""
    image = view(POSE, replace(PLAIN, srgb=True))
    found = detect_tags(image, TARGET)
    found = replace(detect_tags(image, TARGET, camera=found.camera), camera=found.camera)
    searches = []
    monkeypatch.setattr(detector, "find_box", lambda *a, **k: searches.append(1) or find_box(*a, **k))
    return image, found, searches


def _expected(found, off_px):
    return ExpectedTags(ids=found.ids, corners_px=found.corners_px + off_px)


@pytest.mark.parametrize("modules", [0.0, 0.4, 0.9])
def test_tags_about_a_module_from_where_they_are_expected_are_found_without_a_search(seen, modules):
    image, found, searches = seen
    way = modules * MODULE_PX * np.array([0.8, -0.6])
    again = detect_tags(image, TARGET, camera=found.camera, expected=_expected(found, way))
    assert not searches
    np.testing.assert_array_equal(again.ids, found.ids)
    apart = np.linalg.norm(again.corners_px - found.corners_px, axis=2)
    apart /= np.sqrt(np.trace(found.cov_px2, axis1=2, axis2=3) / 2)
    assert apart.max() < 0.6  # which pixels of a lattice are used depends on where a tag was taken to be


@pytest.mark.parametrize("here", [True, False])
def test_tags_that_may_be_at_many_places_are_found_at_the_one_that_the_picture_resembles(seen, here):
    image, found, searches = seen
    far = 9 * MODULE_PX * np.array([0.8, -0.6])
    steps = np.arange(-3, 24 if here else 14)  # half a module each; the tags lie 18 of them further on
    places = found.corners_px - far + (steps / 18)[:, None, None, None] * far
    expected = replace(_expected(found, -far), places_px=places)
    again = detect_tags(image, TARGET, camera=found.camera, expected=expected)
    np.testing.assert_array_equal(again.ids, found.ids)
    assert bool(searches) is not here


def test_a_picture_resembles_tags_where_they_are(seen):
    image, found, _ = seen
    rows = np.array([TARGET.row_of(int(tag)) for tag in found.ids[::9]])
    steps = np.array([-4.0, -1.0, 0.0, 1.0, 4.0])  # modules
    places = found.corners_px[::9] + MODULE_PX * steps[:, None, None, None] * np.array([0.8, -0.6])
    alike = resemblance(image, PATTERNS, rows, places)
    assert alike[2] > 0.9
    assert np.all(alike[[1, 3]] < 0.6)
    assert np.all(np.abs(alike[[0, 4]]) < expected_tags.ALIKE)


def test_corners_are_not_drawn_to_where_they_were_expected(seen):
    image, found, _ = seen
    uv, _ = truth(POSE)
    error = []
    for way in ([2.0, 0.0], [-2.0, 0.0]):
        again = detect_tags(image, TARGET, camera=found.camera, expected=_expected(found, np.array(way)))
        error.append((again.corners_px - uv[[TARGET.row_of(int(i)) for i in again.ids]]).mean(axis=(0, 1)))
    assert np.abs(error[0] - error[1]).max() < 0.001


def test_other_tags_of_the_box_are_found_from_a_few_expected_ones(seen):
    image, found, searches = seen
    few = np.arange(0, len(found.ids), 7)
    expected = ExpectedTags(ids=found.ids[few], corners_px=found.corners_px[few])
    assert np.array_equal(detect_tags(image, TARGET, camera=found.camera, expected=expected).ids, found.ids)
    assert not searches


@pytest.mark.parametrize("off_px", [0.5, 60.0], ids=["there", "elsewhere"])
def test_no_more_tags_are_measured_than_are_wanted(seen, off_px, monkeypatch):
    image, found, searches = seen
    aligned = []

    def counted(*given, **named):
        aligned.append(len(given[2]))
        return align_coarsely(*given, **named)

    for module in (expected_tags, box_growth):
        monkeypatch.setattr(module, "align_coarsely", counted)
    expected = ExpectedTags(ids=found.ids, corners_px=found.corners_px + off_px, most=8)
    few = detect_tags(image, TARGET, camera=found.camera, expected=expected)
    assert len(few.ids) == 8
    assert np.ptp(few.ids) > 0.8 * np.ptp(found.ids)
    assert np.abs(few.corners_px - found.corners_px[np.isin(found.ids, few.ids)]).max() < 0.02
    assert bool(searches) == (off_px > 1)
    assert searches or max(aligned) <= 10


@pytest.mark.parametrize("off_px", [[60.0, 0.0], [0.0, -200.0], [np.nan, 0.0], [1e6, 0.0]])
def test_the_whole_picture_is_searched_where_expected_tags_are_not_there(seen, off_px):
    image, found, searches = seen
    again = detect_tags(image, TARGET, camera=found.camera, expected=_expected(found, np.array(off_px)))
    assert searches
    np.testing.assert_array_equal(again.corners_px, found.corners_px)


def test_an_expected_tag_that_is_covered_is_not_found(seen):
    image, found, searches = seen
    k = len(found.ids) // 2
    (left, top), (right, bottom) = found.corners_px[k].min(axis=0).astype(int), found.corners_px[k].max(axis=0)
    image[top : int(bottom), left : int(right)] = 128
    again = detect_tags(image, TARGET, camera=found.camera, expected=_expected(found, 1.0))
    assert not searches
    assert found.ids[k] not in again.ids
    assert len(again.ids) >= len(found.ids) - 3


def test_expected_tags_that_the_target_does_not_carry_are_passed_over(seen):
    image, found, _ = seen
    expected = ExpectedTags(
        ids=np.append(found.ids, 500), corners_px=np.concatenate([found.corners_px, found.corners_px[:1]])
    )
    assert np.array_equal(detect_tags(image, TARGET, expected=expected).ids, found.ids)
