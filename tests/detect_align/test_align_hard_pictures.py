"""Pictures that used to go wrong, each with its truth; see shared/cases/README.md."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from aligned_views import PLAIN, SIZE, TARGET, pose, truth, view, width_px

from boxcal.detect.alignment.detection import DetectorSettings
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.image.bayer import alternation, unnamed_mosaic


@pytest.fixture(scope="module")
def pictures(shared_data: Path) -> Path:
    return shared_data.parent / "cases" / "pictures"


def _seen(folder: Path, name: str):
    """Return what is found, recall of tags wider than 10 px that the truth has, and their normalised errors."""
    truth = json.loads((folder / f"{name}.truth.json").read_text())
    picture = next(p for p in folder.glob(f"{name}.*") if p.suffix in {".png", ".jpg"})
    uv = {int(tag): np.array(corners) for tag, corners in truth.items()}
    wanted = [tag for tag, corners in uv.items() if width_px(corners[None])[0] >= 10]
    tags = detect_tags(cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE), TARGET)
    known = np.isin(tags.ids, wanted)
    errors = tags.corners_px[known] - np.array([uv[int(tag)] for tag in tags.ids[known]])
    normalised = np.linalg.solve(np.linalg.cholesky(tags.cov_px2[known]), errors[..., None])
    return tags, known.sum() / len(wanted), float(normalised.std())


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("shadow", 1.0, 1.3),
        ("glare", 0.95, 1.3),
        ("wrinkled", 1.0, 1.3),
        ("pixel_aspect_095", 1.0, 1.3),
        ("sheared", 1.0, 1.3),
        ("poster_same_layout", 1.0, 1.35),
        ("motion_3px", 1.0, 1.3),
        ("raw_mosaic", 1.0, 1.3),
    ],
)
def test_hard_picture_is_read_as_well_as_by_the_best_peer_and_its_sigmas_hold(pictures, name, least, most):
    _, recall, sigma = _seen(pictures, name)
    assert recall >= least
    assert 0.8 < sigma < most


def test_prints_on_a_wall_are_said_and_the_box_is_taken(pictures):
    tags, _, _ = _seen(pictures, "poster_same_layout")
    assert set(TARGET.tag_faces[tags.ids]) == {1}
    assert tags.contradicting_faces == (0, 2)


def test_faces_that_contradict_each_other_are_not_named_where_there_is_one_box(pictures):
    for name in ("shadow", "wrinkled", "glare"):
        assert _seen(pictures, name)[0].contradicting_faces == ()


def test_a_mosaic_sent_as_grey_is_recognised_and_a_grey_picture_is_none(pictures):
    mosaic = cv2.imread(str(pictures / "raw_mosaic.png"), cv2.IMREAD_GRAYSCALE)
    assert unnamed_mosaic(mosaic) is not None
    for name in ("shadow.png", "glare.jpg", "motion_3px.png"):
        assert unnamed_mosaic(cv2.imread(str(pictures / name), cv2.IMREAD_GRAYSCALE)) is None
    assert unnamed_mosaic(view(pose(20.0), replace(PLAIN, noise=25.0, psf_px=0.0))) is None


def test_rows_of_an_interlaced_picture_alternate():
    image = view(pose(20.0))
    woven = image.copy()
    woven[1::2] = np.roll(image, 6, axis=1)[1::2]
    assert alternation(woven) == (False, True)
    assert alternation(image) == (False, False)


@pytest.mark.parametrize("azimuth", [0.0, 20.0, 55.0])
def test_rows_alternate_that_moved_by_two_pixels_and_have_no_black_border(azimuth):
    image = view(pose(azimuth, distance=0.9))
    assert alternation(image) == (False, False)
    woven = image.copy()
    woven[1::2, 2:] = image[1::2, :-2]
    assert alternation(woven) == (False, True)


def test_an_interlaced_picture_of_something_that_moved_is_located_midway():
    T = pose(20.0, distance=0.6)
    uv, _ = truth(T)
    image = view(T)
    fields = [cv2.warpAffine(image, np.array([[1.0, 0, side], [0, 1, 0]]), None) for side in (-1.0, 1.0)]
    woven = fields[0].copy()
    woven[1::2] = fields[1][1::2]
    found = detect_tags(woven, TARGET)
    assert set(range(35)) <= set(found.ids.tolist())  # those of the face that is not seen at a slant
    error = found.corners_px - uv[found.ids]
    assert np.sqrt(np.mean(error**2)) < 0.04
    assert 0.5 < np.linalg.solve(np.linalg.cholesky(found.cov_px2), error[..., None]).std() < 1.5


@pytest.mark.parametrize("srgb", [True, False])
def test_a_preview_tells_the_response_curve_and_how_sure_its_corners_are(srgb):
    T = pose(10.0, distance=0.55)
    uv, _ = truth(T)
    tags = detect_tags(view(T, replace(PLAIN, srgb=srgb)), TARGET, DetectorSettings(fast=True))
    assert tags.response == ("srgb" if srgb else "linear")
    errors = tags.corners_px - uv[tags.ids]
    assert 0.4 < np.linalg.solve(np.linalg.cholesky(tags.cov_px2), errors[..., None]).std() < 1.4


def test_a_hard_shadow_leaves_all_tags_and_their_sigmas():
    T = pose(20.0, distance=0.6)
    uv, seen = truth(T)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    middle = uv[seen].mean(axis=(0, 1))
    side = (x - middle[0]) * np.cos(0.7) + (y - middle[1]) * np.sin(0.7)
    light = 0.33 + 0.67 / (1 + np.exp(-np.clip(side / 0.7, -50, 50)))
    tags = detect_tags(np.rint(view(T) * light).astype(np.uint8), TARGET)
    wanted = seen[width_px(uv[seen]) >= 10]
    assert np.isin(wanted, tags.ids).mean() > 0.97
    errors = tags.corners_px - uv[tags.ids]
    assert 0.6 < np.linalg.solve(np.linalg.cholesky(tags.cov_px2), errors[..., None]).std() < 1.5


def test_a_face_seen_twice_is_said_and_the_larger_sighting_is_kept():
    T = pose(0.0, distance=0.5)
    image = view(T)
    small = cv2.resize(image, None, fx=0.45, fy=0.45, interpolation=cv2.INTER_AREA)
    both = np.full((SIZE[1], 2 * SIZE[0]), 120, np.uint8)
    both[:, : SIZE[0]] = image
    both[40 : 40 + small.shape[0], SIZE[0] + 100 : SIZE[0] + 100 + small.shape[1]] = small
    tags = detect_tags(both, TARGET)
    assert 0 in tags.contradicting_faces
    on_face = TARGET.tag_faces[tags.ids] == 0
    assert on_face.sum() > 20
    assert np.all(tags.corners_px[on_face][..., 0] < SIZE[0])


def test_a_box_that_shows_two_faces_wins_over_an_enlarged_print_of_one_of_them():
    T = pose(40.0, distance=0.9)
    uv, seen = truth(T)
    both = np.concatenate([view(T), view(pose(0.0, distance=0.45, roll_deg=0.0))], axis=1)
    tags = detect_tags(both, TARGET)
    assert 0 in tags.contradicting_faces
    assert set(np.unique(TARGET.tag_faces[tags.ids])) == {0, 1}
    assert np.isin(seen[width_px(uv[seen]) >= 10], tags.ids).mean() > 0.97
    np.testing.assert_allclose(tags.corners_px, uv[tags.ids], atol=0.2)


def test_both_faces_of_a_near_box_are_found_where_one_is_seen_at_a_slant(pictures):
    """With fewer pixels for tags that the box predicts, a third of the tags was lost, and 6 % of the focal length."""
    found = detect_tags(cv2.imread(str(pictures / "fast_linear_1280.jpg"), cv2.IMREAD_UNCHANGED), TARGET)
    assert len(found.ids) == 54
    log_deviation = found.camera.prior.deviation[0]
    assert abs(np.log(found.camera.prior.focal_px / 1200)) < 3 * log_deviation < 0.05
