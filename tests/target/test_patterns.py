import subprocess
import sys

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from boxcal.target.errors import TargetError
from boxcal.target.tags.families import dictionary_names, family_size, modules_per_side, tag_modules
from boxcal.target.tags.outline import Loop, black_outline

FAMILY = "DICT_APRILTAG_36h11"


def even_odd_fill(loops: tuple[Loop, ...], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Black modules by crossing number: a ray to the right of each module's centre, against every vertical edge."""
    inside = np.zeros(shape, dtype=bool)
    for loop in loops:
        for (x0, y0), (x1, y1) in zip(loop, loop[1:] + loop[:1], strict=True):
            if x0 == x1:
                inside[min(y0, y1) : max(y0, y1), :x0] ^= True
    return inside


def test_36h11_tag_0_carries_the_code_that_the_apriltag_library_publishes() -> None:
    # 0xd5d628584 is the first code of tag36h11 (AprilTag 2); OpenCV draws AprilTags turned by half a turn.
    bits = np.rot90(tag_modules(FAMILY, 0)[1:-1, 1:-1], 2).ravel()
    assert int("".join("1" if bit else "0" for bit in bits), 2) == 0xD5D628584


def test_36h11_has_587_ids_of_8_modules_and_every_border_is_black() -> None:
    assert (family_size(FAMILY), modules_per_side(FAMILY)) == (587, 8)
    for tag_id in (0, 139, 586):
        modules = tag_modules(FAMILY, tag_id)
        assert modules.shape == (8, 8)
        assert not np.any(modules[[0, -1]])
        assert not np.any(modules[:, [0, -1]])
        assert np.any(modules)


def test_tags_of_one_family_differ_in_at_least_its_hamming_distance_also_when_turned() -> None:
    tags = [tag_modules(FAMILY, i) for i in range(140)]
    for i, one in enumerate(tags):
        for other in tags[i + 1 :]:
            assert min(int(np.sum(one ^ np.rot90(other, k))) for k in range(4)) >= 11


def test_every_family_that_is_listed_can_be_used() -> None:
    assert FAMILY in dictionary_names()
    for name in dictionary_names():
        assert tag_modules(name, family_size(name) - 1).shape == (modules_per_side(name),) * 2


def test_an_unknown_family_is_refused_with_the_valid_names() -> None:
    with pytest.raises(TargetError, match=r"'tag36h11': no such tag family; use one of .*DICT_APRILTAG_36h11"):
        tag_modules("tag36h11", 0)


@pytest.mark.parametrize("tag_id", [-1, 587])
def test_an_id_outside_the_family_is_refused_with_its_range(tag_id: int) -> None:
    with pytest.raises(TargetError, match=f"tag id {tag_id}: {FAMILY} has ids 0 to 586"):
        tag_modules(FAMILY, tag_id)


@settings(max_examples=200, deadline=None)
@given(arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=8)))
def test_outline_filled_even_odd_gives_back_the_modules(white: NDArray[np.bool_]) -> None:
    assert np.array_equal(even_odd_fill(black_outline(white), white.shape), ~white)


@settings(max_examples=100, deadline=None)
@given(arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=8)))
def test_outline_runs_along_each_border_between_black_and_white_just_once(white: NDArray[np.bool_]) -> None:
    padded = np.pad(white, 1, constant_values=True)
    borders = int(np.sum(padded[1:] ^ padded[:-1]) + np.sum(padded[:, 1:] ^ padded[:, :-1]))
    length = 0
    for loop in black_outline(white):
        corners = np.array(loop)
        sides = np.roll(corners, -1, axis=0) - corners
        assert np.all((sides[:, 0] == 0) ^ (sides[:, 1] == 0)), "a side is neither level nor upright"
        assert np.all((sides[:, 0] == 0) ^ (np.roll(sides, 1, axis=0)[:, 0] == 0)), "a corner where nothing turns"
        length += int(np.abs(sides).sum())
    assert length == borders


def test_the_outlines_of_all_tags_of_the_default_box_agree_with_opencv_filling_them() -> None:
    scale = 8
    for tag_id in range(140):
        modules = tag_modules(FAMILY, tag_id)
        image = np.full((8 * scale, 8 * scale), 255, dtype=np.uint8)
        # fillPoly fills even-odd and includes its boundary, so only the modules' centres are compared.
        cv2.fillPoly(image, [np.array(loop, dtype=np.int32) * scale for loop in black_outline(modules)], (0,))
        assert np.array_equal(image[scale // 2 :: scale, scale // 2 :: scale] > 127, modules)


def test_importing_patterns_does_not_load_opencv() -> None:
    code = "import sys, boxcal.target.tags.families; sys.exit('cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_outline_of_a_chessboard_keeps_its_black_modules_apart() -> None:
    white = (np.add.outer(np.arange(2), np.arange(2)) % 2).astype(bool)
    assert sorted(map(len, black_outline(white))) == [4, 4]


@given(st.integers(1, 6), st.integers(1, 6))
def test_outline_of_plain_black_is_its_four_corners(rows: int, columns: int) -> None:
    (loop,) = black_outline(np.zeros((rows, columns), dtype=bool))
    assert set(loop) == {(0, 0), (columns, 0), (columns, rows), (0, rows)}
    assert len(loop) == 4
