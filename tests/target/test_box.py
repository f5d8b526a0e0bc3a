import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boxcal.target.box import Box, make_target
from boxcal.target.errors import TargetError

TL, TR, BR, BL = range(4)


@pytest.mark.parametrize(
    ("tag_id", "corner", "p_box"),
    [
        (0, TL, (0.125, -0.119, 0.184)),
        (0, BR, (0.125, -0.091, 0.156)),
        (34, BR, (0.125, 0.119, 0.016)),
        (35, TL, (0.119, 0.125, 0.184)),
        (139, BR, (0.119, -0.125, 0.016)),
    ],
)
def test_default_box_has_the_corners_that_its_drawing_gives(
    tag_id: int, corner: int, p_box: tuple[float, float, float]
) -> None:
    target = make_target()
    assert np.allclose(target.p_box(np.array([4 * tag_id + corner]))[0], p_box, rtol=0, atol=1e-12)


def test_default_box_is_140_tags_of_28_mm_at_a_pitch_of_35_mm() -> None:
    target = make_target()
    assert list(target.tag_ids) == list(range(140))
    assert list(target.tag_faces) == [tag // 35 for tag in range(140)]
    sides = np.linalg.norm(np.roll(target.tag_corners, -1, axis=1) - target.tag_corners, axis=2)
    assert np.allclose(sides, 0.028, rtol=0, atol=1e-12)
    centres = target.tag_corners.mean(axis=1)
    assert np.allclose(np.linalg.norm(np.diff(centres.reshape(4, 5, 7, 3), axis=2), axis=3), 0.035, rtol=0, atol=1e-12)
    assert np.allclose(np.linalg.norm(np.diff(centres.reshape(4, 5, 7, 3), axis=1), axis=3), 0.035, rtol=0, atol=1e-12)


def test_face_0_centres_follow_the_formula_of_the_drawing() -> None:
    centres = make_target().tag_corners[:35].mean(axis=1).reshape(5, 7, 3)
    for row in range(5):
        for column in range(7):
            expected = (0.125, (column - 3) * 0.035, 0.100 - (row - 2) * 0.035)
            assert np.allclose(centres[row, column], expected, rtol=0, atol=1e-12)


def test_face_f_of_a_square_box_is_face_0_turned_by_f_right_angles_about_z() -> None:
    corners = make_target().tag_corners.reshape(4, 35, 4, 3)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for face in range(1, 4):
        turned = corners[0] @ np.linalg.matrix_power(quarter, face).T
        assert np.allclose(corners[face], turned, rtol=0, atol=1e-12)


def test_corners_run_clockwise_from_top_left_as_seen_from_outside() -> None:
    box = Box(width=0.30, depth=0.26, height=0.22)
    target = make_target(box)
    for corners, face in zip(target.tag_corners, target.tag_faces, strict=True):
        T = box.T_box_face(int(face))
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1, rel=1e-12)
        p_face = (corners - T[:3, 3]) @ T[:3, :3]
        assert np.allclose(p_face[:, 2], 0, atol=1e-12)
        assert p_face[TL, 0] == pytest.approx(p_face[BL, 0], abs=1e-12)
        assert p_face[TL, 0] < p_face[TR, 0]
        assert p_face[TL, 1] > p_face[BL, 1]
        assert corners[TL, 2] > corners[BL, 2]
        outward = np.cross(corners[TR] - corners[TL], corners[TL] - corners[BL])
        assert outward @ corners.mean(axis=0) > 0


def test_an_oblong_box_puts_its_faces_at_half_its_width_and_depth() -> None:
    box = Box(width=0.30, depth=0.26, columns=6, rows=2, first_id=100)
    target = make_target(box)
    corners = target.tag_corners.reshape(4, -1, 3)
    assert np.allclose(corners[0, :, 0], 0.15, atol=1e-12)
    assert np.allclose(corners[1, :, 1], 0.13, atol=1e-12)
    assert np.allclose(corners[2, :, 0], -0.15, atol=1e-12)
    assert np.allclose(corners[3, :, 1], -0.13, atol=1e-12)
    assert [box.face_width(face) for face in range(4)] == [0.26, 0.30, 0.26, 0.30]
    assert (target.tag_ids[0], target.tag_ids[-1]) == (100, 147)
    assert corners[:, :, 2].mean() == pytest.approx(0.1, rel=1e-12)


@given(
    columns=st.integers(1, 5),
    rows=st.integers(1, 4),
    tag_size=st.floats(0.01, 0.05),
    gap=st.floats(0.13, 1.0),
    spare=st.floats(1.02, 2.0),
)
def test_any_box_that_is_accepted_keeps_tags_inside_their_faces(
    columns: int, rows: int, tag_size: float, gap: float, spare: float
) -> None:
    pitch, border = tag_size * (1 + gap), tag_size / 4
    width = ((columns - 1) * pitch + tag_size + border) * spare
    box = Box(
        width=width,
        depth=width * 1.1,
        height=((rows - 1) * pitch + tag_size + border) * spare,
        columns=columns,
        rows=rows,
        tag_size=tag_size,
        pitch=pitch,
    )
    target = make_target(box)
    module = tag_size / 8
    for face in range(4):
        T = box.T_box_face(face)
        p_face = (target.tag_corners[target.tag_faces == face] - T[:3, 3]) @ T[:3, :3]
        assert np.all(np.abs(p_face[..., 0]) <= box.face_width(face) / 2 - module + 1e-9)
        assert np.all(np.abs(p_face[..., 1]) <= box.height / 2 - module + 1e-9)


def test_p_box_looks_up_landmarks_by_id_and_knows_which_tags_there_are() -> None:
    target = make_target(Box(first_id=10))
    assert 10 in target
    assert 9 not in target
    assert 150 not in target
    assert target.row_of(149) == 139
    landmarks = np.array([4 * 44 + BR, 4 * 10 + TL])
    assert np.allclose(target.p_box(landmarks), [[0.125, 0.119, 0.016], [0.125, -0.119, 0.184]], atol=1e-12)
    with pytest.raises(KeyError):
        target.p_box(np.array([0]))


@pytest.mark.parametrize("name", ["width", "depth", "height", "tag_size", "pitch"])
@pytest.mark.parametrize("value", [0.0, -0.1, float("nan"), float("inf"), 100.0])
def test_a_length_that_is_no_length_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(TargetError, match=f"^{name} is {value}: a length between 0 and 100 m is needed"):
        Box(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"columns": 0}, "0 columns by 5 rows: at least one of each"),
        ({"rows": -1}, "7 columns by -1 rows: at least one of each"),
        ({"columns": 101, "rows": 100}, "at most 10000 tags a face"),
        ({"pitch": 0.031}, "leave 3 mm between them, a white border of one module .3.5 mm. is needed; enlarge pitch"),
        ({"pitch": 0.02}, "leave -8 mm between them"),
        ({"width": 0.24}, "the tags need 245 mm with their white border, the face has 240 mm; enlarge width and depth"),
        ({"depth": 0.24}, "the face has 240 mm; enlarge width and depth, or reduce columns"),
        ({"height": 0.17}, "need 175 mm with their white border, the face has 170 mm; enlarge height, or reduce rows"),
        ({"first_id": 448}, "ids 448 to 587: DICT_APRILTAG_36h11 has ids 0 to 586; change first_id"),
        ({"first_id": -1}, "ids -1 to 138"),
        ({"dictionary": "DICT_4X4_50"}, "ids 0 to 139: DICT_4X4_50 has ids 0 to 49"),
        ({"dictionary": "tag36h11"}, "dictionary 'tag36h11': no such tag family; use one of"),
    ],
)
def test_an_impossible_box_is_refused_with_the_figure_to_change(figures: dict[str, object], message: str) -> None:
    with pytest.raises(TargetError, match=message):
        Box(**figures)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "figures",
    [
        {"pitch": 0.0315},  # a gap of one module exactly
        {"width": 0.245, "depth": 0.245},  # the white border ends at the edge exactly
        {"height": 0.175},
        {"first_id": 447},
        {"columns": 1, "rows": 1, "pitch": 0.001},  # a single tag has no neighbour
    ],
)
def test_a_box_at_the_limit_is_accepted(figures: dict[str, object]) -> None:
    assert make_target(Box(**figures)).tag_ids.size >= 4  # type: ignore[arg-type]
