"""Pictures of the assembled box: what they show is what a camera there would see."""

import cv2
import numpy as np
import pytest

from boxcal.detect.tags.detections import find_tags
from boxcal.target.box import Box, make_target
from boxcal.target.render.pictures import box_pictures

BOX = Box(width=0.2, depth=0.16, height=0.15, columns=3, rows=3, tag_size=0.035, pitch=0.044, first_id=7)


@pytest.fixture(scope="module")
def pictures() -> dict[str, np.ndarray]:
    files = box_pictures(make_target(BOX))
    return {name: cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) for name, data in files.items()}


def faces_in(picture: np.ndarray) -> dict[int, float]:
    """Faces whose tags a detector finds, and where along the picture they lie, px."""
    target = make_target(BOX)
    tags = find_tags(picture, target)
    faces = target.tag_faces[[target.row_of(int(tag)) for tag in tags.ids]]
    return {int(face): float(tags.corners_px[faces == face, :, 0].mean()) for face in np.unique(faces)}


def test_the_first_picture_shows_faces_0_and_1_from_above(pictures: dict[str, np.ndarray]) -> None:
    found = faces_in(pictures["box.jpg"])
    assert set(found) == {0, 1}
    assert found[0] < found[1]


def test_the_robot_sees_face_0(pictures: dict[str, np.ndarray]) -> None:
    assert 0 in faces_in(pictures["robot.jpg"])


def test_four_views_go_around_the_box(pictures: dict[str, np.ndarray]) -> None:
    sheet = pictures["around.jpg"]
    height, width = sheet.shape[0] // 2, sheet.shape[1] // 2
    views = [sheet[r * height : (r + 1) * height, c * width : (c + 1) * width] for r in (0, 1) for c in (0, 1)]
    for face, view in enumerate(views):
        found = faces_in(view)
        assert set(found) == {face, (face + 1) % 4}
        assert found[face] < found[(face + 1) % 4], "the next face lies to the right, seen from outside"
