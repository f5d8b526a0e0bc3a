import json

import cv2
import numpy as np
import pytest
from aligned_views import TARGET, pose, truth, view

from boxcal.detect.cli import main
from boxcal.target.box import Box, make_target
from boxcal.target.files.target_json import save_target


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "seen.png"
    cv2.imwrite(str(path), view(pose(15.0)))
    return path


def test_command_writes_corners_and_pictures(picture, tmp_path, capsys):
    out = tmp_path / "corners.json"
    assert main([str(picture), "--json", str(out), "--draw", str(tmp_path / "drawn")]) == 0
    uv, _ = truth(pose(15.0))
    document = json.loads(out.read_text())
    tags = document["images"][0]["tags"]
    assert len(tags) >= 35
    assert max(np.abs(np.array(t["corners_px"]) - uv[t["id"]]).max() for t in tags) < 0.2
    drawn = cv2.imread(str(next((tmp_path / "drawn").glob("*.png"))))
    assert drawn.shape[1] >= 640
    assert "face 0" in capsys.readouterr().out


def test_command_prints_json_alone_on_standard_output(picture, capsys):
    assert main([str(picture), "--json", "-", "--fast"]) == 0
    assert json.loads(capsys.readouterr().out)["images"][0]["image"] == "seen.png"


def test_one_bad_picture_does_not_hide_the_others(picture, tmp_path, capsys):
    bad = tmp_path / "bad.png"
    bad.write_bytes(b"no picture")
    assert main([str(bad), str(tmp_path / "none.png"), str(picture)]) == 1
    said = capsys.readouterr()
    assert "seen.png: " in said.out
    assert "bad.png: not a picture" in said.err
    assert "none.png: cannot be read" in said.err


def test_command_reads_the_target_it_is_given(tmp_path, capsys):
    target = make_target(Box(dictionary="DICT_5X5_100", columns=4, rows=3, tag_size=0.04, pitch=0.05))
    save_target(target, tmp_path / "target.json")
    cv2.imwrite(str(tmp_path / "a.png"), view(pose(20.0), target=target))
    assert main([str(tmp_path / "a.png"), "--target", str(tmp_path / "target.json")]) == 0
    assert "12 on face 0" in capsys.readouterr().out


def test_missing_target_is_named(picture, tmp_path, capsys):
    assert main([str(picture), "--target", str(tmp_path / "no.json")]) == 1
    assert "no.json" in capsys.readouterr().err


def test_picture_without_tags_says_so(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((200, 200), 128, np.uint8))
    assert main([str(tmp_path / "grey.png")]) == 0
    assert "no tags" in capsys.readouterr().out
    assert TARGET.tag_ids.size == 140
