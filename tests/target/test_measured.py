"""Measured figures: how corners follow them, how they are stored, and what is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from boxcal.target.box import Box, make_target
from boxcal.target.errors import TargetError
from boxcal.target.files.target_json import design_sha256, load_target, save_target, target_bytes, target_sha256
from boxcal.target.measure.measured_size import SIZES, Measured
from boxcal.target.measure.size_influence import scale_influence, size_jacobian

BOX = Box(width=0.30, depth=0.26, height=0.21)
DESIGNED = np.array([1.0, 1.0, BOX.width, BOX.depth, BOX.height])
COV = np.diag([1e-6, 1e-6, 1e-7, 1e-7, 1e-7]) + 1e-8


def measured(figures: np.ndarray[Any, Any], cov: np.ndarray[Any, Any] = COV) -> Measured:
    return Measured(**dict(zip(SIZES, map(float, figures), strict=True)), cov=cov)


def test_figures_as_designed_give_the_corners_as_designed() -> None:
    target, plain = make_target(BOX, measured(DESIGNED)), make_target(BOX)
    assert np.array_equal(target.tag_corners, plain.tag_corners)
    assert np.array_equal(target.tag_ids, plain.tag_ids)
    assert plain.measured is None


def test_a_print_of_another_scale_stands_on_the_base_centred_between_the_edges() -> None:
    target = make_target(BOX, measured(np.array([0.99, 1.02, 0.304, 0.258, 0.215])))
    faces, plain = (t.tag_corners.reshape(4, 35, 4, 3) for t in (target, make_target(BOX)))
    assert np.allclose(faces[..., 2], 1.02 * plain[..., 2], atol=1e-12)
    assert np.allclose(faces[0][..., 0], 0.152, atol=1e-12)
    assert np.allclose(faces[3][..., 1], -0.129, atol=1e-12)
    assert np.allclose(faces[0][..., 1], 0.99 * plain[0][..., 1], atol=1e-12)
    assert np.allclose(faces[1][..., 0], 0.99 * plain[1][..., 0], atol=1e-12)


def test_a_measured_face_has_its_pose_at_the_centre_of_its_print() -> None:
    target = make_target(BOX, measured(np.array([0.99, 1.02, 0.304, 0.258, 0.215])))
    for face in range(4):
        T = target.T_box_face(face)
        p_face = (target.tag_corners[target.tag_faces == face] - T[:3, 3]) @ T[:3, :3]
        assert np.allclose(p_face[..., :2], BOX.grid_corners() * (0.99, 1.02), atol=1e-12)
        assert np.allclose(p_face[..., 2], 0, atol=1e-12)
        assert np.array_equal(make_target(BOX).T_box_face(face), BOX.T_box_face(face))


@settings(max_examples=20, deadline=None)
@given(offs=st.lists(st.floats(-0.04, 0.04), min_size=5, max_size=5))
def test_size_jacobian_agrees_with_central_differences(offs: list[float]) -> None:
    figures = DESIGNED * (1 + np.array(offs))
    J = size_jacobian(make_target(BOX, measured(figures)))
    assert J.shape == (140, 4, 3, 5)
    step = 1e-4
    for k in range(5):
        ahead, behind = (
            make_target(BOX, measured(figures + sign * step * np.eye(5)[k])).tag_corners for sign in (1, -1)
        )
        assert np.allclose(J[..., k], (ahead - behind) / (2 * step), rtol=0, atol=1e-10)
    assert np.allclose(size_jacobian(make_target(BOX)), J, atol=1e-12), "corners are linear in the sizes"


def test_scale_influence_is_one_in_all_when_every_size_grows_alike() -> None:
    """All sizes one per mille larger are the same box one per mille larger."""
    for box in (Box(), BOX):
        lengths = np.array([1.0, 1.0, box.width, box.depth, box.height])
        assert scale_influence(make_target(box)) @ lengths == pytest.approx(1, rel=1e-12)


def test_a_measured_target_comes_back_from_its_file_as_it_was(tmp_path: Path) -> None:
    target = make_target(BOX, measured(DESIGNED * (0.997, 0.998, 1.001, 1 / 1.003, 1.01)))
    save_target(target, tmp_path / "target.json")
    loaded = load_target(tmp_path / "target.json")
    assert loaded.box == BOX
    assert loaded.measured is not None
    assert target.measured is not None
    assert all(getattr(loaded.measured, name) == getattr(target.measured, name) for name in SIZES)
    assert np.array_equal(loaded.measured.cov, COV)
    assert np.allclose(loaded.tag_corners, target.tag_corners, rtol=0, atol=1e-12)
    assert target_sha256(loaded) == target_sha256(target) != target_sha256(make_target(BOX))


def test_a_design_is_stored_without_a_word_of_measuring() -> None:
    assert b"measured" not in target_bytes(make_target())
    stored = Path(__file__).resolve().parents[2] / "printables" / "target.json"
    assert stored.read_bytes() == target_bytes(make_target())


def set_measured(key: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        document["measured"][key] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(measured=3), "'measured' must hold sx, sy, width"),
        (lambda d: d["measured"].pop("cov"), "'measured' must hold sx, sy, width"),
        (lambda d: d.pop("measured"), r"corners of tag \d+ lie 1 mm from where the file's own dimensions put them"),
        (set_measured("cov_order", ["sy", "sx", "width", "depth", "height"]), "cov_order must be sx, sy"),
        (set_measured("sx", "1"), "measured.sx is '1', a float is needed"),
        (set_measured("sx", True), "measured.sx is True"),
        (set_measured("sx", float("nan")), "NaN is no JSON number"),
        (set_measured("sx", 10**400), "must be numbers"),
        (set_measured("width", -0.3), "measured width is -0.3"),
        (set_measured("width", 0.303), "corners of tag 0 lie 0.5 mm from"),
        (set_measured("height", 0.25), r"measured height is 250 mm, 210 mm was designed: \+19.0% off"),
        (set_measured("sy", 0.94), 'print scale sy is 0.94, 1 was designed: -6.0% off.*"fit to page"'),
        (set_measured("cov", [[1.0] * 5] * 4), "5 rows of 5 numbers"),
        (set_measured("cov", "none"), "must be numbers"),
        (set_measured("cov", [[float("inf")] * 5] * 5), "Infinity is no JSON number"),
        (set_measured("cov", (-np.eye(5)).tolist()), "it is no covariance"),
        (set_measured("cov", np.triu(np.ones((5, 5))).tolist()), "it is no covariance"),
    ],
)
def test_an_edited_measurement_is_refused_by_name(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    target = make_target(BOX, measured(DESIGNED + np.array([0, 0, 0.002, 0, 0])))
    document = json.loads(target_bytes(target))
    change(document)
    path = tmp_path / "target.json"
    path.write_text(json.dumps(document))
    with pytest.raises(TargetError, match=rf"target\.json: .*({message})"):
        load_target(path)


def test_a_figure_beyond_all_floats_is_refused(tmp_path: Path) -> None:
    document = json.loads(target_bytes(make_target()))
    document["box"]["width"] = 10**400
    (tmp_path / "target.json").write_text(json.dumps(document))
    with pytest.raises(TargetError, match=r"a dimension of 'box' is too large"):
        load_target(tmp_path / "target.json")


@pytest.mark.parametrize("k", range(5))
def test_a_figure_is_credible_up_to_5_percent_and_not_beyond(k: int) -> None:
    make_target(BOX, measured(DESIGNED * (1 + 0.0499 * np.eye(5)[k])))
    with pytest.raises(TargetError, match="fit to page"):
        make_target(BOX, measured(DESIGNED * (1 - 0.0501 * np.eye(5)[k])))


def test_measuring_leaves_the_design_as_it_was() -> None:
    plain = make_target()
    once, anew = (
        make_target(measured=Measured(sx=s, sy=1.0, width=0.25, depth=0.2501, height=0.2, cov=np.eye(5) * 1e-8))
        for s in (1.001, 1.002)
    )
    assert design_sha256(plain) == target_sha256(plain)
    assert design_sha256(once) == design_sha256(anew) == design_sha256(plain)
    assert len({target_sha256(t) for t in (plain, once, anew)}) == 3
    assert design_sha256(make_target(Box(first_id=140))) != design_sha256(plain)
