"""Corners carried from the lens under which a tag was aligned to a better one."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import CAMERA, PATTERNS, SIZE, TARGET, pose, truth, view

from boxcal.detect.alignment.box_pose import fit_box
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.fine_alignment import aligned_again
from boxcal.detect.alignment.radial_camera import A1, CENTRE_X, P1, P2, no_distortion, square, tangential, unsquare
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_curvature import under_lens
from boxcal.detect.image.response_curve import response_table
from boxcal.target.render.renderer import SensorModel

LENS = no_distortion(SIZE)
LENS[A1] = 0.03


def _aligned(lens, grey):
    frame = Frame(grey=(grey / np.float32(255)), response=response_table("linear"), lens=lens)
    uv, rows = truth(pose())
    first = align(frame, PATTERNS, rows, uv[rows])
    return align(frame, PATTERNS, rows, first.corners_px, start=first, stop_px=1e-4).corners_px


def _rms(errors):
    return np.sqrt(np.mean(errors**2))


def test_corners_carried_to_a_lens_are_those_aligned_under_it():
    better = LENS.copy()
    better[A1] += 0.02
    better[CENTRE_X] += 30
    grey = view(pose(), SensorModel(psf_px=0.6))
    before, after = _aligned(LENS, grey), _aligned(better, grey)
    assert np.abs(after - before).max() > 0.005
    carried = under_lens(LENS, better, before)
    assert _rms(carried - after) < 0.3 * _rms(after - before)
    np.testing.assert_array_equal(under_lens(LENS, LENS, before), before)


def test_the_way_back_leads_to_the_same_corners():
    uv, rows = truth(pose())
    better = LENS.copy()
    better[A1] += 0.01
    there = under_lens(LENS, better, uv[rows])
    np.testing.assert_allclose(under_lens(better, LENS, there), uv[rows], atol=1e-4)
    assert under_lens(LENS, better, np.zeros((0, 4, 2))).shape == (0, 4, 2)


def test_tangential_terms_curve_tags_as_much_as_they_curve_the_picture():
    uv, rows = truth(pose())
    corners = uv[rows]
    better = LENS.copy()
    better[[P1, P2]] = 0.002, -0.001
    moved = under_lens(LENS, better, corners) - corners
    # the second difference of the tangential field along a tag's diagonal says how far it is bent
    middle = corners.mean(axis=1)
    d = square(better, np.stack([corners[:, 0], middle, corners[:, 2]]) - better[:2])
    field = unsquare(better, tangential(better, d))
    bend = 0.5 * (field[0] + field[2]) - field[1]
    mean = moved.mean(axis=1)
    at = np.linalg.norm(bend, axis=1) > 0.3 * np.linalg.norm(bend, axis=1).max()
    ratio = np.sum(mean[at] * bend[at]) / np.sum(bend[at] ** 2)
    assert -0.8 < ratio < -0.2


@pytest.mark.parametrize("kr", [-0.25, 0.1])
def test_large_tags_far_from_the_centre_err_as_little_as_their_covariances_say(kr):
    camera = replace(CAMERA, kr=kr)
    squares = []
    for azimuth in (10.0, 35.0, 60.0):
        T = pose(azimuth, distance=0.4)
        found = detect_tags(view(T, camera=camera, seed=int(azimuth)), TARGET)
        uv, _ = truth(T, camera=camera)
        error = found.corners_px - uv[[TARGET.row_of(int(i)) for i in found.ids]]
        squares.append(np.sum(np.linalg.solve(found.cov_px2, error[..., None])[..., 0] * error, axis=2).ravel() / 2)
    assert np.mean(np.concatenate(squares)) < 1.3


def test_tags_with_their_own_light_keep_their_alignment_under_tangential_terms():
    """All tags are carried to these in the end; where others are aligned again it would be a second time."""
    T = pose(20.0, distance=0.6)
    uv, rows = truth(T)
    frame = Frame(grey=view(T) / np.float32(255), response=response_table("linear"), lens=LENS)
    tags = align(frame, PATTERNS, rows, uv[rows] + 0.1)
    fit = fit_box(TARGET, tags.rows, tags.corners_px, image_size=SIZE, sigma_px=0.05)
    decentred, further = LENS.copy(), LENS.copy()
    decentred[[P1, P2]] = 0.002, -0.001
    further[A1] += 0.01
    for lens, least, most in ((decentred, 0.0, 1e-9), (further, 1e-4, 1.0)):
        again, own = aligned_again(frame, replace(frame, lens=lens), TARGET, PATTERNS, tags, rows[:3], fit)
        np.testing.assert_array_equal(own.rows, rows[:3])
        assert not np.isin(again.rows, rows[:3]).any()
        moved = np.abs(own.corners_px - tags.corners_px[:3]).max()
        assert least <= moved <= most
        assert np.isnan(own.block_sums).all()
