"""SVG of faces and net: every tag reads as designed at its place, in millimetres."""

import re
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest

from boxcal.target.arrays import Image
from boxcal.target.box import Box, make_target
from boxcal.target.print.svg import svg_files
from boxcal.target.tags.families import load_dictionary

SVG = "{http://www.w3.org/2000/svg}"
SMALL = make_target(Box(width=0.12, depth=0.13, height=0.12, columns=3, rows=3))
PX_A_MM = 8


def layer(root: ET.Element, name: str) -> ET.Element:
    (group,) = [g for g in root.iter(f"{SVG}g") if g.get("id") == name]
    return group


def drawn(root: ET.Element) -> Image:
    """The tags as a program fills them: even-odd, 8 px a mm."""
    left, top, width, height = map(float, (root.get("viewBox") or "").split())
    picture = np.full((round(height * PX_A_MM), round(width * PX_A_MM)), 255, dtype=np.uint8)
    for path in layer(root, "tags").iter(f"{SVG}path"):
        assert path.get("fill-rule") == "evenodd"
        loops = []
        for part in re.findall(r"M([^MZ]*) Z", path.get("d") or ""):
            points = np.array([[float(v) for v in p.split(",")] for p in part.split(" L")])
            loops.append(np.rint((points - (left, top)) * PX_A_MM * 16).astype(np.int32) - 8)
        cv2.fillPoly(picture, loops, 0, shift=4)
    return picture


@pytest.mark.parametrize("face", range(4))
def test_a_face_reads_as_designed_in_exact_size(face: int) -> None:
    root = ET.fromstring(svg_files(SMALL)[f"face-{face}.svg"])
    assert float((root.get("width") or "").removesuffix("mm")) == pytest.approx(SMALL.box.face_width(face) * 1e3 + 10)
    corners, ids, _ = cv2.aruco.ArucoDetector(load_dictionary(SMALL.box.dictionary)).detectMarkers(drawn(root))
    assert sorted(np.ravel(ids).tolist()) == SMALL.tag_ids[SMALL.tag_faces == face].tolist()
    left, top, *_ = map(float, (root.get("viewBox") or "").split())
    for tag, found in zip(np.ravel(ids), corners, strict=True):
        T = SMALL.box.T_box_face(face)
        p_face = (SMALL.tag_corners[SMALL.row_of(int(tag))] - T[:3, 3]) @ T[:3, :2] * 1e3
        seen = np.reshape(found, (4, 2)) / PX_A_MM + (left, top)
        assert seen == pytest.approx(p_face * (1, -1), abs=0.3)


def test_the_net_has_all_tags_an_outline_and_folds() -> None:
    root = ET.fromstring(svg_files(SMALL)["net.svg"])
    _, ids, _ = cv2.aruco.ArucoDetector(load_dictionary(SMALL.box.dictionary)).detectMarkers(drawn(root))
    assert sorted(np.ravel(ids).tolist()) == SMALL.tag_ids.tolist()
    assert [g.get("id") for g in root.iter(f"{SVG}g")] == ["cut", "fold", "tags", "text"]
    (cut,) = layer(root, "cut").iter(f"{SVG}path")
    assert (cut.get("d") or "").count("M") == 1
    assert len(list(layer(root, "text").iter(f"{SVG}text"))) == 4
