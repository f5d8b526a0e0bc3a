"""The exact means of ink over rectangles of a sheet."""

import numpy as np
import pytest

from boxcal.target.box import Box, make_target
from boxcal.target.render.texture import FaceTexture, face_texture

BOXES = [Box(), Box(pitch=0.0353, columns=6), Box(columns=2, rows=2, tag_size=0.06, pitch=0.0893)]


def texture_of(box: Box) -> FaceTexture:
    texture = face_texture(make_target(box), 1)
    assert texture is not None
    return texture


def sampled_ink(texture: FaceTexture, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    i = np.searchsorted(texture.along_u.breaks, u, side="right")
    j = np.searchsorted(texture.along_v.breaks, v, side="right")
    return texture.cells[j, i]


def rectangles(box: Box, widest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    extent = box.columns * box.pitch / box.tag_size * 8
    u, v = rng.uniform(-3, extent + 3, (2, 400)).astype(np.float32)
    widths = rng.uniform(0.05, widest, (2, 400)).astype(np.float32)
    return u, v, widths[0], widths[1]


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize(("widest", "method"), [(1.0, "mean_ink"), (1.0, "mean_ink_wide"), (25.0, "mean_ink_wide")])
def test_mean_ink_agrees_with_dense_sampling(box: Box, widest: float, method: str) -> None:
    texture = texture_of(box)
    u, v, width_u, width_v = rectangles(box, widest)
    found = getattr(texture, method)(u, v, width_u, width_v)
    steps = (np.arange(200) + 0.5) / 200 - 0.5
    wanted = [
        sampled_ink(texture, a + steps[None, :] * wa, b + steps[:, None] * wb).mean()
        for a, b, wa, wb in zip(u, v, width_u, width_v, strict=True)
    ]
    assert 0.1 < np.mean(wanted) < 0.9
    assert found == pytest.approx(np.array(wanted), abs=0.02)


def test_both_means_agree_where_both_hold() -> None:
    texture = texture_of(Box())
    rectangle = rectangles(Box(), 1.0)
    assert texture.mean_ink(*rectangle) == pytest.approx(texture.mean_ink_wide(*rectangle), abs=2e-4)


@pytest.mark.parametrize("box", BOXES)
def test_uniform_rectangles_hold_one_colour_and_others_two(box: Box) -> None:
    texture = texture_of(box)
    u, v, width_u, width_v = rectangles(box, 3.0)
    uniform, ink = texture.uniform(u, v, width_u / 2, width_v / 2)
    mean = texture.mean_ink_wide(u, v, width_u, width_v)
    assert 40 < uniform.sum() < 380
    assert mean[uniform] == pytest.approx(ink[uniform], abs=1e-6)
    assert np.all((mean[~uniform] > 0) & (mean[~uniform] < 1))


def test_ink_fills_the_tags_and_nothing_else() -> None:
    box = Box()
    texture = texture_of(box)
    u, v = np.meshgrid(np.arange(0.5, 7 * 10), np.arange(0.5, 5 * 10))
    ink = sampled_ink(texture, u, v)
    gap = (u % 10 > 8) | (v % 10 > 8)
    border = ~gap & ((u % 10 < 1) | (u % 10 > 7) | (v % 10 < 1) | (v % 10 > 7))
    assert not ink[gap].any()
    assert ink[border].all()


def test_sheet_starts_at_the_first_tags_corner() -> None:
    target = make_target()
    texture = texture_of(target.box)
    corners = np.array([[0, 0, 1], [8, 0, 1], [8, 8, 1], [0, 8, 1.0]]) @ texture.p_box_sheet.T
    assert corners == pytest.approx(target.tag_corners[35], abs=1e-12)
