"""Pictures of faces: exact at every resolution."""

import io

import cv2
import numpy as np
import pytest

from boxcal.target.box import Box, Target, make_target
from boxcal.target.errors import TargetError
from boxcal.target.models.faces import draw, face_png, face_pngs
from boxcal.target.render.texture import face_texture
from boxcal.target.tags.families import modules_per_side, tag_modules

image_module = pytest.importorskip("PIL.Image")
ODD = Box(width=0.131, depth=0.152, height=0.0937, columns=3, rows=2, tag_size=0.0301, pitch=0.0367, first_id=40)


def decoded(png: bytes) -> np.ndarray:
    picture = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return picture


@pytest.mark.parametrize("box", [Box(), ODD])
@pytest.mark.parametrize("dpi", [72.0, 300.0, 437.3])
def test_every_module_lies_where_the_figures_put_it(box: Box, dpi: float) -> None:
    target = make_target(box)
    modules = modules_per_side(box.dictionary)
    for face in range(4):
        picture = decoded(face_png(target, face, dpi=dpi))
        assert picture.shape == pytest.approx(np.array([box.height, box.face_width(face)]) * dpi / 0.0254, abs=1)
        for tag_id, corners in zip(target.tag_ids[target.tag_faces == face], box.grid_corners(), strict=True):
            steps = (np.arange(modules) + 0.5) / modules * box.tag_size
            x = corners[0, 0] + steps + box.face_width(face) / 2
            y = box.height / 2 - corners[0, 1] + steps
            columns, rows = (np.floor(p / 0.0254 * dpi).astype(int) for p in (x, y))
            assert np.array_equal(picture[np.ix_(rows, columns)] > 127, tag_modules(box.dictionary, int(tag_id)))


def test_pixels_hold_the_mean_ink_below_them() -> None:
    texture = face_texture(make_target(ODD), 2)
    assert texture is not None
    texel, origin = 0.37, np.array([-2.2, -1.7])
    picture = draw(texture, origin, texel, (70, 90))
    u, v = np.meshgrid(origin[0] + (np.arange(90) + 0.5) * texel, origin[1] + (np.arange(70) + 0.5) * texel)
    width = np.full(u.shape, texel)
    ink = texture.mean_ink_wide(u, v, width, width)
    assert picture == pytest.approx(255 * (1 - ink), abs=0.51)
    assert ((picture > 5) & (picture < 250)).sum() > 500


def test_resolution_stands_in_the_file() -> None:
    picture = image_module.open(io.BytesIO(face_png(make_target(ODD), 0, dpi=600)))
    picture.verify()
    assert picture.info["dpi"] == pytest.approx((600, 600), rel=1e-5)


def test_tags_are_as_large_as_designed_at_1200_dpi() -> None:
    picture = decoded(face_png(make_target(), 0, dpi=1200))
    inked = 255 - picture[int(0.030 / 0.0254 * 1200)].astype(float)
    dark = np.flatnonzero(inked > 127)
    assert (dark[-1] - dark[0] + 1) * 25.4 / 1200 == pytest.approx(6 * 35 + 28, abs=0.03)


def test_four_faces_carry_four_pictures() -> None:
    files = face_pngs(make_target(ODD), dpi=50)
    assert list(files) == [f"face-{k}.png" for k in range(4)]
    assert len(set(files.values())) == 4


@pytest.mark.parametrize("dpi", [0.0, -3.0, float("nan"), float("inf"), 1e5])
def test_impossible_resolutions_are_refused(dpi: float) -> None:
    with pytest.raises(TargetError, match="dpi is"):
        face_png(make_target(), 0, dpi=dpi)


def test_a_fifth_face_is_refused() -> None:
    with pytest.raises(TargetError, match="face is 4"):
        face_png(make_target(), 4)


def test_a_measured_print_does_not_change_the_design(wrong_target: Target) -> None:
    assert face_png(wrong_target, 1, dpi=100) == face_png(make_target(), 1, dpi=100)
