import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from boxcal.target.box import Box, make_target
from boxcal.target.errors import TargetError
from boxcal.target.files.json_document import MAX_BYTES
from boxcal.target.files.target_json import load_target, save_target, target_bytes, target_sha256

Document = dict[str, Any]


@pytest.mark.parametrize(
    "box",
    [Box(), Box(width=0.3, depth=0.26, columns=5, rows=3, tag_size=0.0301, pitch=0.0417, first_id=7)],
    ids=["default", "other"],
)
def test_a_target_comes_back_from_its_file_as_it_was(tmp_path: Path, box: Box) -> None:
    target = make_target(box)
    save_target(target, tmp_path / "target.json")
    loaded = load_target(tmp_path / "target.json")
    assert loaded.box == box
    assert np.array_equal(loaded.tag_ids, target.tag_ids)
    assert np.array_equal(loaded.tag_faces, target.tag_faces)
    assert np.allclose(loaded.tag_corners, target.tag_corners, rtol=0, atol=1e-12)
    assert target_sha256(loaded) == target_sha256(target)


def test_the_same_figures_give_the_same_bytes_and_others_give_others() -> None:
    assert target_bytes(make_target()) == target_bytes(make_target(Box()))
    assert target_sha256(make_target(Box(height=0.201))) != target_sha256(make_target())


def test_the_file_is_plain_json_that_a_reader_can_check_by_eye() -> None:
    document = json.loads(target_bytes(make_target()))
    assert (document["schema"], document["units"]) == (1, "m")
    assert document["tags"]["35"][0] == [0.119, 0.125, 0.184]
    assert document["box"]["tag_size"] == 0.028
    assert b"-0.0," not in target_bytes(make_target()).replace(b" ", b"")


def test_a_missing_file_is_refused_with_what_makes_one(tmp_path: Path) -> None:
    with pytest.raises(TargetError, match=r"none\.json: cannot be read .*; make one with make-target"):
        load_target(tmp_path / "none.json")


def test_a_folder_in_place_of_the_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TargetError, match="cannot be read"):
        load_target(tmp_path)


@pytest.mark.parametrize(
    "content", [b"", b"box", b"\xff\xfe\x00", b"[" * 100_000], ids=["empty", "text", "bytes", "deep"]
)
def test_what_is_not_json_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "target.json"
    path.write_bytes(content)
    with pytest.raises(TargetError, match=r"target\.json: (not a whole JSON file|nested deeper)"):
        load_target(path)


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "target.json"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(TargetError, match=r"target\.json: larger than \d+ bytes"):
        load_target(path)


def set_corner(value: object) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        document["tags"]["17"][2][1] = value

    return change


def nudge_corner(document: Document) -> None:
    document["tags"]["17"][2][1] += 1e-6


def set_key(key: str, value: object) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        document[key] = value

    return change


def set_figure(key: str, value: object) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        document["box"][key] = value

    return change


def add_tag(document: Document) -> None:
    document["tags"]["140"] = document["tags"]["139"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("schema"), "no target description in it; make one with make-target"),
        (lambda d: d.pop("tags"), "no target description in it"),
        (set_key("schema", 2), "schema 2, this version reads 1"),
        (set_key("schema", None), "schema None, this version reads 1"),
        (set_key("units", "mm"), r"units 'mm', metres \('m'\) are needed"),
        (lambda d: d.pop("units"), "units None"),
        (lambda d: d.pop("box"), "'box' must hold width, depth, height"),
        (set_key("box", []), "'box' must hold width"),
        (lambda d: d["box"].pop("pitch"), "'box' must hold"),
        (set_figure("colour", "red"), "'box' must hold"),
        (set_figure("width", "0.25"), r"box\.width is '0\.25', a float is needed"),
        (set_figure("columns", 7.0), r"box\.columns is 7\.0, a int is needed"),
        (set_figure("rows", True), r"box\.rows is True"),
        (set_figure("dictionary", 16), r"box\.dictionary is 16"),
        (set_figure("width", float("nan")), "NaN is no JSON number"),
        (set_figure("columns", 10**6), "at most 10000 tags a face"),
        (set_figure("height", 0.21), "corners of tag 0 lie 5 mm from where the file's own dimensions put them"),
        (nudge_corner, "corners of tag 17 lie 0.001 mm from .*; do not edit corners by hand"),
        (set_corner(float("nan")), "NaN is no JSON number"),
        (set_corner(float("inf")), "Infinity is no JSON number"),
        (set_corner("x"), "not 4 points of 3 numbers"),
        (set_corner(None), "corners of tag 17|not 4 points of 3 numbers"),
        (lambda d: d["tags"].pop("17"), "139 tags, its dimensions need ids 0 to 139"),
        (add_tag, "141 tags, its dimensions need ids 0 to 139"),
        (lambda d: d["tags"]["17"].pop(), "not 4 points of 3 numbers"),
        (set_key("tags", {str(i): [[0.0, 0.0]] * 4 for i in range(140)}), "not 4 points of 3 numbers"),
        (set_key("tags", []), "0 tags, its dimensions need ids 0 to 139"),
    ],
)
def test_an_edited_file_is_refused_by_name(tmp_path: Path, change: Callable[[Document], object], message: str) -> None:
    document = json.loads(target_bytes(make_target()))
    change(document)
    path = tmp_path / "target.json"
    path.write_text(json.dumps(document))
    with pytest.raises(TargetError, match=rf"target\.json: .*({message})"):
        load_target(path)


@pytest.mark.parametrize("document", ["3", "null", '"schema tags"', "[1, 2]"])
def test_json_of_another_kind_is_refused(tmp_path: Path, document: str) -> None:
    path = tmp_path / "target.json"
    path.write_text(document)
    with pytest.raises(TargetError, match=r"no target description in it|not a target file"):
        load_target(path)


def test_a_file_that_was_formatted_anew_is_still_read(tmp_path: Path) -> None:
    path = tmp_path / "target.json"
    path.write_text(json.dumps(json.loads(target_bytes(make_target())), indent=1, sort_keys=True))
    assert load_target(path).box == Box()
