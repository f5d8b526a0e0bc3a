"""Growth of the tags' black, told by residuals and taken off the corners."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import CAMERA, PATTERNS, PLAIN, TARGET, bled, pose, truth, view

from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.dot_gain import LEAST, dot_gain, edges, without_dot_gain
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.target.camera.camera_model import project


@pytest.fixture(name="camera")
def camera_of_views():
    return CAMERA


def outward(tags, camera, T):
    """Return how far corners lie outside their places, on the mean."""
    uv = project(camera, TARGET.tag_corners @ T[:3, :3].T + T[:3, 3])[[TARGET.row_of(int(i)) for i in tags.ids]]
    middle = uv.mean(axis=1, keepdims=True)
    away = (uv - middle) / np.linalg.norm(uv - middle, axis=2, keepdims=True)
    return float(np.mean(np.sum((tags.corners_px - uv) * away, axis=2)))


@pytest.mark.parametrize("distance", [0.6, 1.0])
def test_corners_hardly_follow_ink_that_spread(camera, monkeypatch, distance):
    T = pose(20.0, distance=distance)
    image = bled(0.3, camera, T)
    known = outward(detect_tags(image, TARGET), camera, T)
    monkeypatch.setattr("boxcal.detect.alignment.detector.without_dot_gain", lambda _, tags, *__: tags)
    grown = outward(detect_tags(image, TARGET), camera, T)
    assert grown > 0.03
    assert abs(known) < 0.35 * grown


def test_where_no_ink_spread_corners_stay(camera, monkeypatch):
    T = pose(20.0, distance=0.6)
    image = view(T, PLAIN)
    known = detect_tags(image, TARGET).corners_px
    monkeypatch.setattr("boxcal.detect.alignment.detector.without_dot_gain", lambda _, tags, *__: tags)
    assert np.abs(known - detect_tags(image, TARGET).corners_px).max() < 0.001


def test_growth_is_told_in_modules(camera):
    T = pose(20.0, distance=0.6)
    image = bled(0.3, camera, T)
    frame = Frame(
        grey=(image / 255).astype(np.float32), response=np.array([0.0, 1.0]), lens=no_distortion(image.shape[::-1])
    )
    uv = truth(T)[0]
    side = np.linalg.norm(np.roll(uv, -1, axis=1) - uv, axis=2)
    rows = np.flatnonzero(TARGET.tag_faces == 0)
    tags = align(frame, PATTERNS, rows, uv[rows])
    tags = align(frame, PATTERNS, rows, tags.corners_px, start=tags, stop_px=1e-4)
    module = np.exp(np.mean(np.log(side[rows]))) / PATTERNS.modules
    growth = dot_gain(PATTERNS, tags)
    assert growth * (1 + (LEAST / growth) ** 2) == pytest.approx(0.1 / module, rel=0.25)


def test_sums_of_a_known_growth_give_that_growth_and_shifts_light_and_blur_none(camera):
    image = view(pose(20.0, distance=0.6), PLAIN, seed=1)
    frame = Frame(
        grey=(image / 255).astype(np.float32), response=np.array([0.0, 1.0]), lens=no_distortion(image.shape[::-1])
    )
    rows = np.flatnonzero(TARGET.tag_faces == 0)[:6]
    tags = align(frame, PATTERNS, rows, truth(pose(20.0, distance=0.6))[0][rows])
    c = tags.corners_px
    right = (c[:, 1] - c[:, 0] + c[:, 2] - c[:, 3]) / 2 / PATTERNS.modules
    down = (c[:, 3] - c[:, 0] + c[:, 2] - c[:, 1]) / 2 / PATTERNS.modules
    area = np.abs(right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0])[:, None, None]
    cells = PATTERNS.cells[rows]
    inner = cells[:, 1:-1, 1:-1]
    neighbours = np.stack([cells[:, 1:-1, :-2], cells[:, 1:-1, 2:], cells[:, :-2, 1:-1], cells[:, 2:, 1:-1]])
    count = np.sum(neighbours != inner, axis=0)
    for growth, others in ((0.03, 0.0), (0.0, 1.0), (-0.02, 1.0)):
        lost = -0.5 * area * growth * count
        # white modules give light to their neighbours, black ones take it; a shift along u
        lost = lost + others * area * (0.02 * count * (1 - 2 * inner) + 0.01 * inner)
        lost = lost + others * area * 0.03 * -0.5 * (neighbours[1] - neighbours[0])
        blocks = tags.blocks.copy()
        blocks[:, 1:-1, 1:-1, 0] = lost * tags.contrast[:, None, None]
        told = dot_gain(PATTERNS, replace(tags, blocks=blocks, noise=np.full(len(tags), 1e-4)))
        assert told == pytest.approx(growth * growth**2 / (growth**2 + LEAST**2), abs=1e-6)


def test_the_border_alone_would_take_corners_along_by_the_whole_growth_and_patterns_by_half():
    followed = edges(PATTERNS).followed
    outward = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    mean = np.mean(followed * outward)
    assert 0.45 < mean < 0.65
    assert np.all(np.mean(followed * outward, axis=(1, 2)) > 0)


def test_tags_of_which_none_tells_are_left_as_they_are():
    image = view(pose(20.0, distance=0.6), PLAIN, seed=1)
    frame = Frame(
        grey=(image / 255).astype(np.float32), response=np.array([0.0, 1.0]), lens=no_distortion(image.shape[::-1])
    )
    rows = np.flatnonzero(TARGET.tag_faces == 0)[:2]
    tags = align(frame, PATTERNS, rows, truth(pose(20.0, distance=0.6))[0][rows])
    assert without_dot_gain(PATTERNS, tags, tags.rows) is tags
