"""Tags whose places the box through a few others tells are not aligned twice."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import TARGET, pose, truth, view

from boxcal.detect.alignment import box_growth
from boxcal.detect.alignment.box_pose import fit_box
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.placed_by_box import OFF_MODULES, ON_FACE, placed_surely, spread_over_faces
from boxcal.detect.alignment.pyramid import align_coarsely
from boxcal.detect.alignment.tag_patterns import target_patterns
from boxcal.detect.alignment.verification import module_px

POSE = pose(28.0, distance=0.55)
PATTERNS = target_patterns(TARGET)


@pytest.fixture
def aligned(monkeypatch):
    """Return how many tags were aligned roughly in each call."""
    counts = []

    def counted(*given, **named):
        counts.append(len(given[2]))
        return align_coarsely(*given, **named)

    monkeypatch.setattr(box_growth, "align_coarsely", counted)
    return counts


def test_of_a_rigid_box_a_few_tags_of_each_face_are_aligned_roughly(aligned):
    tags = detect_tags(view(POSE), TARGET)
    faces = len(np.unique(TARGET.tag_faces[tags.ids]))
    assert len(tags.ids) > 2 * faces * ON_FACE
    assert sum(aligned) <= 2 * faces * ON_FACE
    assert np.abs(tags.corners_px - truth(POSE)[0][tags.ids]).max() < 0.2


def test_fewer_are_aligned_roughly_where_the_camera_is_known(aligned):
    first = detect_tags(view(POSE), TARGET)
    count = sum(aligned)
    aligned.clear()
    again = detect_tags(view(POSE), TARGET, camera=first.camera)
    np.testing.assert_array_equal(again.ids, first.ids)
    assert 0 < sum(aligned) < 0.7 * count
    assert np.abs(again.corners_px - first.corners_px).max() < 0.05


def test_where_the_box_does_not_tell_all_tags_are_aligned_roughly(aligned, monkeypatch):
    plain = detect_tags(view(POSE), TARGET)
    aligned.clear()
    monkeypatch.setattr(box_growth, "placed_surely", lambda *_, rows, **__: np.zeros(len(rows), dtype=np.bool_))
    every = detect_tags(view(POSE), TARGET)
    assert sum(aligned) >= len(every.ids)
    np.testing.assert_array_equal(every.ids, plain.ids)
    assert np.abs(every.corners_px - plain.corners_px).max() < 0.05


def test_the_first_tags_are_those_at_the_ends_of_a_face():
    uv, rows = truth(POSE)
    first, rest = spread_over_faces(TARGET, rows, uv[rows])
    assert np.array_equal(np.sort(np.concatenate([first, rest])), np.arange(len(rows)))
    for face in np.unique(TARGET.tag_faces[rows]):
        here = TARGET.tag_faces[rows] == face
        assert here[first].sum() == min(ON_FACE, here.sum())
        all_of_it, some = uv[rows[here]].mean(axis=1), uv[rows[first[here[first]]]].mean(axis=1)
        assert (np.ptp(some, axis=0) > 0.85 * np.ptp(all_of_it, axis=0)).all()


def _fitted(off_px, left_out=lambda _: 0):
    """Return a box, the tags that it goes through, those asked, and the rest; of a face so many are left out."""
    uv, rows = truth(POSE)
    asked = spread_over_faces(TARGET, rows, uv[rows])[0]
    rest = np.setdiff1d(rows, rows[asked])
    moved = uv[rows[asked]] + np.random.default_rng(1).normal(0, off_px, (len(asked), 1, 2))
    faces = TARGET.tag_faces[rows[asked]]
    there = np.concatenate([np.flatnonzero(faces == face)[left_out(face) :] for face in np.unique(faces)])
    fit = fit_box(TARGET, rows[asked[there]], moved[there], image_size=(640, 480), sigma_px=0.05)
    return fit, rows[asked[there]], rows[asked], rest


def test_a_box_tells_the_rest_only_of_faces_where_the_first_tags_are_there():
    fit, there, asked, rest = _fitted(0.02)
    assert placed_surely(TARGET, PATTERNS, fit, believed=there, asked=asked, rows=rest).all()
    face = TARGET.tag_faces[rest[0]]
    fit, there, asked, rest = _fitted(0.02, lambda other: 3 if other == face else 0)
    sure = placed_surely(TARGET, PATTERNS, fit, believed=there, asked=asked, rows=rest)
    np.testing.assert_array_equal(sure, TARGET.tag_faces[rest] != face)


def test_a_box_through_one_face_that_leaves_out_another_tells_nothing():
    """As where the box is not as described, and a few tags of one face are fitted with a camera that is not there."""
    face = TARGET.tag_faces[truth(POSE)[1][0]]
    fit, there, asked, rest = _fitted(0.02, lambda other: 0 if other == face else ON_FACE)
    assert not placed_surely(TARGET, PATTERNS, fit, believed=there, asked=asked, rows=rest).any()


def test_a_box_on_which_the_first_tags_do_not_lie_tells_nothing():
    fit, there, asked, rest = _fitted(1.0)
    assert not placed_surely(TARGET, PATTERNS, fit, believed=there, asked=asked, rows=rest).any()


def test_large_tags_that_are_px_off_do_not_keep_the_box_from_telling_where_narrow_ones_are():
    """Roughly aligned tags are off by a share of their own modules: what counts is how many modules that is."""
    fit, there, asked, rest = _fitted(0.02)
    narrow = TARGET.tag_faces[rest] == min(np.unique(TARGET.tag_faces[rest]), key=lambda f: _module_px(rest, f))
    limit = 0.9 * OFF_MODULES * module_px(PATTERNS, truth(POSE)[0][there])
    wider = limit > 1.3 * OFF_MODULES * _module_px(rest, TARGET.tag_faces[rest[narrow]][0])
    assert 2 * wider.sum() > len(there)
    rough = replace(fit, off_px=limit)
    assert placed_surely(TARGET, PATTERNS, rough, believed=there, asked=asked, rows=rest[narrow]).all()


def _module_px(rows, face):
    return np.median(module_px(PATTERNS, truth(POSE)[0][rows[TARGET.tag_faces[rows] == face]]))
