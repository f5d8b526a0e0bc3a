"""Tags that the border of the picture cuts: their corners and what these are worth."""

import numpy as np
import pytest
from aligned_views import CAMERA, PATTERNS, PLAIN, SIZE, TARGET, pose, truth, view

from boxcal.detect.alignment.box_pose import fit_box
from boxcal.detect.alignment.cut_tags import carried_to_lens, cut_by_border
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.radial_camera import A1, CENTRE_X, no_distortion
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_curvature import followed_in_part, under_lens
from boxcal.detect.image.response_curve import response_table
from boxcal.target.camera.camera_model import project

LENS = no_distortion(SIZE)
LENS[A1] = 0.03
BETTER = LENS.copy()
BETTER[A1] += 0.02
BETTER[CENTRE_X] += 30


def _near(width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a picture of near tags of which only so many columns are left, their corners, and rows with any in it."""
    T = pose(20.0, distance=0.4)
    uv = project(CAMERA, TARGET.tag_corners @ T[:3, :3].T + T[:3, 3])
    rows = truth(T)[1]
    return view(T)[:, :width], uv, rows[uv[rows].mean(axis=1)[:, 0] < width - 12]


def _aligned(lens, grey, rows, corners):
    frame = Frame(grey=np.ascontiguousarray(grey) / np.float32(255), response=response_table("linear"), lens=lens)
    first = align(frame, PATTERNS, rows, corners)
    return align(frame, PATTERNS, rows, first.corners_px, start=first, stop_px=1e-4).corners_px


def test_tags_seen_all_round_are_carried_as_whole_ones() -> None:
    uv, rows = truth(pose())
    followed = followed_in_part(uv[rows], (10_000, 10_000))
    inside = np.all(uv[rows] > 0, axis=(1, 2))
    np.testing.assert_allclose(
        under_lens(LENS, BETTER, uv[rows], followed)[inside], under_lens(LENS, BETTER, uv[rows])[inside], atol=1e-9
    )


@pytest.mark.parametrize("width", [300, 308, 316])
def test_corners_of_cut_tags_are_carried_by_what_is_seen_of_them(width: int) -> None:
    grey, uv, rows = _near(width)
    size = (width, SIZE[1])
    before, after = (_aligned(lens, grey, rows, uv[rows]) for lens in (LENS, BETTER))
    beyond = before[..., 0] > width - 0.5
    assert beyond.any()
    as_whole = under_lens(LENS, BETTER, before) - after
    in_part = under_lens(LENS, BETTER, before, followed_in_part(before, size)) - after
    assert np.abs(as_whole[beyond]).max() > 0.03
    assert np.sqrt(np.mean(in_part[beyond] ** 2)) < 0.5 * np.sqrt(np.mean(as_whole[beyond] ** 2))


def test_tags_within_a_module_of_the_border_are_cut() -> None:
    corners = np.array([[10.0, 10.0], [90.0, 10.0], [90.0, 90.0], [10.0, 90.0]])
    shifted = np.stack([corners, corners - 5, corners + np.array([538.0, 0]), corners + np.array([540.0, 0])])
    assert cut_by_border(PATTERNS, shifted, SIZE).tolist() == [False, True, False, True]


def test_what_a_lens_leaves_open_is_in_the_covariance_of_corners_beyond_the_border_only() -> None:
    _, uv, rows = _near(SIZE[0])
    fit = fit_box(TARGET, rows, uv[rows], image_size=SIZE, sigma_px=0.02)
    cut = uv[rows] + np.array([SIZE[0] - uv[rows][0].max(axis=0)[0] + 4, 0.0])
    _, added = carried_to_lens(fit.lens, fit, cut[:1], SIZE)
    sigma = np.sqrt(np.trace(added[0], axis1=1, axis2=2))
    beyond = cut[0, :, 0] > SIZE[0] - 0.5
    assert beyond.any()
    assert sigma[beyond].max() > 3 * sigma[~beyond].min()


@pytest.mark.parametrize("psf_px", [0.3, 1.0])
def test_corners_of_cut_tags_err_as_their_covariances_say(psf_px: float) -> None:
    rng, squares, cut = np.random.default_rng(2), [], 0
    for k in range(20):
        T = pose(rng.uniform(0, 360), distance=rng.uniform(0.3, 0.5), elevation_deg=rng.uniform(0, 25))
        T[:2, 3] += rng.uniform(-0.12, 0.12, 2)
        uv, _ = truth(T)
        tags = detect_tags(view(T, PLAIN.__class__(noise=1.0, psf_px=psf_px), seed=k), TARGET)
        at = cut_by_border(PATTERNS, tags.corners_px, SIZE)
        cut += int(at.sum())
        error = tags.corners_px[at] - uv[tags.ids[at]]
        squares.append(np.einsum("nci,ncij,ncj->nc", error, np.linalg.inv(tags.cov_px2[at]), error).ravel())
    z2 = np.concatenate(squares)
    assert cut >= 25
    assert z2.max() < 30  # a chance of 3e-7 for each of them
    assert np.mean(z2) < 2 * 1.6
