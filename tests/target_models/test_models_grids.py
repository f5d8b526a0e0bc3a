"""Grids in the manner of Kalibr: right where they are written, refused where they would be wrong."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from boxcal.target.box import Box, Target, make_target
from boxcal.target.errors import TargetError
from boxcal.target.models.kalibr import face_grid_yaml, face_grids


@pytest.mark.parametrize("scale", [1.0, 0.996])
@pytest.mark.parametrize("box", [Box(), Box(columns=3, rows=2, tag_size=0.0301, pitch=0.0367, first_id=40)])
def test_every_corner_follows_from_the_grid(box: Box, scale: float) -> None:
    target = make_target(box)
    target = replace(target, tag_corners=target.tag_corners * (scale, scale, scale))
    for face in range(4):
        grid = yaml.safe_load(face_grid_yaml(target, face))
        T, size = np.array(grid["T_box_grid"]), grid["tagSize"]
        pitch = size * (1 + grid["tagSpacing"])
        seen = set()
        for row in range(grid["tagRows"]):
            for column in range(grid["tagCols"]):
                low = np.array([column * pitch, row * pitch, 0])
                square = low + np.array([[0, size, 0], [size, size, 0], [size, 0, 0], [0, 0, 0]])
                tag = grid["tagIds"][row][column]
                seen.add(tag)
                wanted = target.tag_corners[target.row_of(tag)]
                assert square @ T[:3, :3].T + T[:3, 3] == pytest.approx(wanted, abs=1e-8)
        assert seen == set(target.tag_ids[target.tag_faces == face].tolist())


def test_a_print_scaled_unevenly_is_left_out_with_the_reason(wrong_target: Target) -> None:
    with pytest.raises(TargetError, match="off a regular grid"):
        face_grid_yaml(wrong_target, 0)
    files = face_grids(wrong_target)
    assert list(files) == ["left-out.txt"]
    assert files["left-out.txt"].count(b"\n") == 4
