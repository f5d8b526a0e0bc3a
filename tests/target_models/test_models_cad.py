"""CAD, cut files and two-colour prints, opened by readers that know nothing of this project."""

import io
import zipfile
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from boxcal.target.arrays import Array

pytest.importorskip("cadquery", reason="the extra 'cad' is not installed", exc_type=ImportError)
ezdxf = pytest.importorskip("ezdxf", reason="the extra 'cad' is not installed")
m3 = pytest.importorskip("manifold3d", reason="the extra 'cad' is not installed")

from boxcal.target.box import Box, Target, make_target  # noqa: E402
from boxcal.target.cad.build import Build, build_for, margins, pin_places  # noqa: E402
from boxcal.target.cad.cut import net_dxf, panels_dxf  # noqa: E402
from boxcal.target.cad.inlay import box_3mf, panels_3mf, prints  # noqa: E402
from boxcal.target.cad.numbers import bars, face_number  # noqa: E402
from boxcal.target.cad.panels import panels, widened  # noqa: E402
from boxcal.target.cad.solid import box_step, box_stls, panels_step  # noqa: E402
from boxcal.target.cad.tags import tag_loops  # noqa: E402
from boxcal.target.errors import TargetError  # noqa: E402
from boxcal.target.tags.families import modules_per_side, tag_modules  # noqa: E402

SMALL = Box(width=0.131, depth=0.152, height=0.0937, columns=3, rows=2, tag_size=0.0301, pitch=0.0367, first_id=40)
LARGE = Box(width=0.5, depth=0.5, height=0.4, columns=7, rows=5, tag_size=0.056, pitch=0.07, first_id=140)
BOXES = [Box(), SMALL]
OUTER_MM = 0.01


def size_mm(box: Box) -> Array:
    return np.array([box.width, box.depth, box.height]) * 1e3


def digit_area_mm2(digit: int, height: float) -> float:
    area = 0.0
    cuts_x = sorted({float(x) for low, high in bars(digit, height) for x in (low[0], high[0])})
    cuts_y = sorted({float(y) for low, high in bars(digit, height) for y in (low[1], high[1])})
    for x0, x1 in pairwise(cuts_x):
        for y0, y1 in pairwise(cuts_y):
            middle = np.array([x0 + x1, y0 + y1]) / 2
            if any(np.all((low < middle) & (middle < high)) for low, high in bars(digit, height)):
                area += (x1 - x0) * (y1 - y0)
    return area * 1e6


def body_volume_mm3(box: Box, build: Build) -> float:
    w, d, h = size_mm(box)
    t, tab = build.wall * 1e3, build.tab * 1e3
    volume = w * d * h - (w - 2 * t) * (d - 2 * t) * (h - t) + 4 * tab**3 / 6
    for face in range(4):
        number = face_number(box, face)
        if number is not None:
            volume -= digit_area_mm2(face, number[1]) * build.engraving * 1e3
        radius, depth = (build.pin + build.pin_play) * 500, (build.wall - build.pin_floor) * 1e3
        volume -= len(pin_places(box, build, face)) * np.pi * radius**2 * depth
    return float(volume)


def read_step(content: bytes, folder: Path) -> dict[str, Any]:
    """Solids of a STEP file by their product's name, read with Open CASCADE's document reader."""
    from OCP.IFSelect import IFSelect_RetDone  # noqa: PLC0415
    from OCP.STEPCAFControl import STEPCAFControl_Reader  # noqa: PLC0415
    from OCP.TCollection import TCollection_ExtendedString  # noqa: PLC0415
    from OCP.TDataStd import TDataStd_Name  # noqa: PLC0415
    from OCP.TDF import TDF_LabelSequence  # noqa: PLC0415
    from OCP.TDocStd import TDocStd_Document  # noqa: PLC0415
    from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool  # noqa: PLC0415

    path = folder / "read.step"
    path.write_bytes(content)
    document = TDocStd_Document(TCollection_ExtendedString("read"))
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    assert reader.ReadFile(str(path)) == IFSelect_RetDone
    assert reader.Transfer(document)
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    roots, parts = TDF_LabelSequence(), TDF_LabelSequence()
    tool.GetFreeShapes(roots)
    assert roots.Length() == 1
    XCAFDoc_ShapeTool.GetComponents_s(roots.Value(1), parts)
    found = {}
    for k in range(1, parts.Length() + 1):
        name = TDataStd_Name()
        assert parts.Value(k).FindAttribute(TDataStd_Name.GetID_s(), name)
        found[name.Get().ToExtString()] = XCAFDoc_ShapeTool.GetShape_s(parts.Value(k))
    return found


def bounds_mm(shape: Any) -> Array:
    from OCP.Bnd import Bnd_Box  # noqa: PLC0415
    from OCP.BRepBndLib import BRepBndLib  # noqa: PLC0415

    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape, box, False, False)
    return np.array(box.Get()).reshape(2, 3)


def volume_mm3(shape: Any) -> float:
    from OCP.BRepGProp import BRepGProp  # noqa: PLC0415
    from OCP.GProp import GProp_GProps  # noqa: PLC0415

    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    return float(properties.Mass())


@pytest.mark.parametrize("box", BOXES, ids=["default", "small"])
def test_step_holds_body_and_lid_of_the_right_size_and_volume(box: Box, tmp_path: Path) -> None:
    from OCP.BRepCheck import BRepCheck_Analyzer  # noqa: PLC0415

    build, (w, d, h) = build_for(box), size_mm(box)
    content = box_step(make_target(box))
    assert b"SI_UNIT(.MILLI.,.METRE.)" in content
    assert b"1970-01-01" in content
    parts = read_step(content, tmp_path)
    assert set(parts) == {"body", "lid"}
    for shape in parts.values():
        assert BRepCheck_Analyzer(shape).IsValid()
    assert bounds_mm(parts["body"]) == pytest.approx(np.array([[-w / 2, -d / 2, 0], [w / 2, d / 2, h]]), abs=OUTER_MM)
    assert volume_mm3(parts["body"]) == pytest.approx(body_volume_mm3(box, build), rel=1e-6)
    gap = (build.wall + build.lid_gap) * 1e3
    lid = np.array([[gap - w / 2, gap - d / 2, h - build.wall * 1e3], [w / 2 - gap, d / 2 - gap, h]])
    assert bounds_mm(parts["lid"]) == pytest.approx(lid, abs=OUTER_MM)


def test_lid_rests_on_the_tabs_and_overlaps_nothing(tmp_path: Path) -> None:
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Common  # noqa: PLC0415
    from OCP.BRepExtrema import BRepExtrema_DistShapeShape  # noqa: PLC0415

    parts = read_step(box_step(make_target(SMALL)), tmp_path)
    assert volume_mm3(BRepAlgoAPI_Common(parts["body"], parts["lid"]).Shape()) == pytest.approx(0, abs=1e-6)
    assert BRepExtrema_DistShapeShape(parts["body"], parts["lid"]).Value() == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("box", BOXES, ids=["default", "small"])
def test_stl_parts_are_watertight_and_true_to_size(box: Box) -> None:
    trimesh = pytest.importorskip("trimesh")
    build, (w, d, h) = build_for(box), size_mm(box)
    files = box_stls(make_target(box))
    assert set(files) == {"body.stl", "lid.stl", "pin.stl"}
    meshes = {name: trimesh.load(io.BytesIO(content), file_type="stl") for name, content in files.items()}
    for name, mesh in meshes.items():
        assert mesh.is_watertight, name
        assert mesh.is_winding_consistent, name
        assert mesh.bounds[0][2] == pytest.approx(0, abs=1e-6), name
    body = meshes["body.stl"]
    assert body.bounds == pytest.approx(np.array([[-w / 2, -d / 2, 0], [w / 2, d / 2, h]]), abs=OUTER_MM)
    assert body.volume == pytest.approx(body_volume_mm3(box, build), rel=1e-4)
    assert meshes["pin.stl"].extents[:2] == pytest.approx([build.pin * 1e3] * 2, abs=OUTER_MM)


@pytest.mark.parametrize("box", BOXES, ids=["default", "small"])
def test_panels_fill_the_walls_without_overlap(box: Box, tmp_path: Path) -> None:
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Common  # noqa: PLC0415

    (w, d, h), t = size_mm(box), build_for(box).wall * 1e3
    parts = read_step(panels_step(make_target(box)), tmp_path)
    assert set(parts) == {"face0", "face1", "face2", "face3", "base", "lid"}
    whole = w * d * h - (w - 2 * t) * (d - 2 * t) * (h - 2 * t)
    assert sum(volume_mm3(shape) for shape in parts.values()) == pytest.approx(whole, rel=1e-9)
    names = sorted(parts)
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            common = BRepAlgoAPI_Common(parts[first], parts[second]).Shape()
            assert volume_mm3(common) == pytest.approx(0, abs=1e-6), (first, second)
    corners = np.stack([bounds_mm(shape) for shape in parts.values()])
    assert corners[:, 0].min(axis=0) == pytest.approx([-w / 2, -d / 2, 0], abs=OUTER_MM)
    assert corners[:, 1].max(axis=0) == pytest.approx([w / 2, d / 2, h], abs=OUTER_MM)
    face0 = bounds_mm(parts["face0"])
    assert face0 == pytest.approx(np.array([[w / 2 - t, -d / 2, 0], [w / 2, d / 2, h]]), abs=OUTER_MM)


def test_pins_stay_clear_of_tags_and_of_each_other() -> None:
    box, build = Box(), Build()
    hole = build.pin + build.pin_play
    ends = []
    for face in range(4):
        places = pin_places(box, build, face)
        beside, above = margins(box, face)
        assert len(places) == 4
        inner = np.array([box.face_width(face) / 2 - beside, box.height / 2 - above])
        assert np.all(np.any(np.abs(places) - hole / 2 > inner, axis=1)), "a hole lies below a tag"
        T = box.T_box_face(face)
        ends.append(np.column_stack([places, np.zeros(4)]) @ T[:3, :3].T + T[:3, 3])
    points = np.concatenate(ends)
    apart = np.linalg.norm(points[:, None] - points, axis=2)[~np.eye(len(points), dtype=bool)]
    assert apart.min() > build.wall + hole


@pytest.mark.parametrize("box", [Box(), SMALL, LARGE])
def test_numbers_leave_the_tags_their_white_border(box: Box) -> None:
    module = box.tag_size / modules_per_side(box.dictionary)
    for face in range(4):
        number = face_number(box, face)
        assert number is not None
        place, height = number
        top = max(place[1] + high[1] for _, high in bars(face, height))
        low = min(place[1] + low[1] for low, _ in bars(face, height))
        assert -box.height / 2 < low
        assert top <= box.grid_corners()[..., 1].min() - module + 1e-12


def test_a_box_full_of_tags_is_built_without_numbers_and_pins(tmp_path: Path) -> None:
    box = Box(width=0.0927, depth=0.0927, height=0.0927, columns=4, rows=4, tag_size=0.02, pitch=0.0225)
    build = build_for(box)
    assert face_number(box, 0) is None
    assert not any(len(pin_places(box, build, face)) for face in range(4))
    body = read_step(box_step(make_target(box)), tmp_path)["body"]
    assert volume_mm3(body) == pytest.approx(body_volume_mm3(box, build), rel=1e-6)


def polylines(content: bytes) -> dict[str, list[Array]]:
    """Polylines of a DXF by layer, mm."""
    document = ezdxf.read(io.StringIO(content.decode()))
    assert not document.audit().errors
    assert document.header["$INSUNITS"] == 4, "not in millimetres"
    found: dict[str, list[Array]] = {}
    for entity in document.modelspace():
        assert entity.dxftype() == "LWPOLYLINE"
        points = np.array([(x, y) for x, y, *_ in entity.get_points()])
        low, high = document.header["$EXTMIN"], document.header["$EXTMAX"]
        assert np.all(points >= np.array(low)[:2] - 1e-6)
        assert np.all(points <= np.array(high)[:2] + 1e-6)
        assert entity.closed == (entity.dxf.layer in {"CUT", "ENGRAVE"})
        found.setdefault(entity.dxf.layer, []).append(np.vstack([points, points[:1]]) if entity.closed else points)
    return found


def signed_area(loop: Array) -> float:
    x, y = loop[:-1].T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def ink_area_mm2(target: Target, face: int) -> float:
    module = target.box.tag_size / modules_per_side(target.box.dictionary) * 1e3
    ids = target.tag_ids[target.tag_faces == face]
    return float(sum((~tag_modules(target.box.dictionary, int(tag))).sum() for tag in ids) * module**2)


def is_inked(loops: list[Array], points: Array) -> Array:
    """Whether points (N, 2) lie within the loops, even-odd."""
    (x0, y0), (x1, y1) = (np.concatenate([loop[part] for loop in loops]).T for part in (np.s_[:-1], np.s_[1:]))
    x0, y0, x1, y1 = (v[y0 != y1] for v in (x0, y0, x1, y1))
    x, y = points[:, :1], points[:, 1:]
    crossed = (y >= np.minimum(y0, y1)) & (y < np.maximum(y0, y1)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return np.asarray(crossed.sum(axis=1) % 2 == 1)


def tags_read_from(loops: list[Array], target: Target, face: int, middle_mm: Array) -> None:
    """Check that each module of a face's tags is inked, or not, where the target's corners put it.

    Looked at 0.1 mm from the middle of each module's sides, so that a shift of more than that is found.
    """
    T = target.box.T_box_face(face)
    middles = np.array([(loop.min(axis=0) + loop.max(axis=0)) / 2 for loop in loops])
    for row in np.flatnonzero(target.tag_faces == face):
        white = tag_modules(target.box.dictionary, int(target.tag_ids[row]))
        corners = ((target.tag_corners[row] - T[:3, 3]) @ T[:3, :3])[:, :2] * 1e3 + middle_mm
        steps = (np.arange(len(white)) + 0.5) / len(white)
        points = (
            corners[0]
            + steps[None, :, None] * (corners[1] - corners[0])
            + steps[:, None, None] * (corners[3] - corners[0])
        )
        close = np.abs(middles - corners.mean(axis=0)).max(axis=1) < np.ptp(corners, axis=0).max() / 2
        near = [loops[k] for k in np.flatnonzero(close)]
        half = np.linalg.norm(corners[1] - corners[0]) / len(white) / 2 - 0.1
        for shift in ((0, 0), (half, 0), (-half, 0), (0, half), (0, -half)):
            assert np.array_equal(is_inked(near, (points + shift).reshape(-1, 2)), ~white.ravel())


@pytest.mark.parametrize("case", ["small", "built wrong"])
def test_net_folds_up_to_the_target(case: str, wrong_target: Target) -> None:
    target = make_target(SMALL) if case == "small" else wrong_target
    box = target.box
    layers = polylines(net_dxf(target))
    assert set(layers) == {"CUT", "FOLD", "ENGRAVE", "NUMBER"}
    (outline,) = layers["CUT"]
    w, d, h = size_mm(box)
    assert abs(signed_area(outline)) > 2 * (w + d) * h + 2 * w * d
    assert all(len(fold) == 2 for fold in layers["FOLD"])
    lengths = Counter(round(float(np.linalg.norm(fold[1] - fold[0])), 3) for fold in layers["FOLD"])
    assert lengths[round(h, 3)] >= 4
    starts = np.cumsum([0, d, w, d])
    for face in range(4):
        middle = np.array([starts[face] + box.face_width(face) * 500, h / 2])
        tags_read_from(layers["ENGRAVE"], target, face, middle)


def test_panels_to_cut_carry_their_tags_in_place(wrong_target: Target) -> None:
    box, build = wrong_target.box, Build()
    layers = polylines(panels_dxf(wrong_target))
    assert set(layers) == {"CUT", "ENGRAVE", "NUMBER"}
    assert len(layers["CUT"]) == 6
    wanted = {
        panel.name: abs(signed_area(np.vstack([panel.outline, panel.outline[:1]]))) * 1e6
        for panel in panels(box, build)
    }
    assert sorted(abs(signed_area(loop)) for loop in layers["CUT"]) == pytest.approx(sorted(wanted.values()), rel=1e-6)
    assert sum(wanted.values()) * build.wall * 1e3 == pytest.approx(250 * 250 * 200 - 244 * 244 * 194, rel=1e-9)
    for face in range(4):
        outline = layers["CUT"][face]
        assert np.ptp(outline, axis=0) == pytest.approx([250, 200], abs=OUTER_MM)
        tags_read_from(layers["ENGRAVE"], wrong_target, face, (outline.min(axis=0) + outline.max(axis=0)) / 2)


def test_kerf_widens_every_outline_by_half_of_it() -> None:
    for panel in panels(SMALL, build_for(SMALL)):
        loop = np.vstack([panel.outline, panel.outline[:1]])
        wide = widened(panel.outline, 1e-4)
        grown = abs(signed_area(np.vstack([wide, wide[:1]]))) - abs(signed_area(loop))
        around = np.abs(np.diff(loop, axis=0)).sum()
        assert grown == pytest.approx(1e-4 * around + 4e-8, rel=1e-6)
    plain, cut = (polylines(panels_dxf(make_target(SMALL), kerf=kerf))["CUT"] for kerf in (0.0, 2e-4))
    assert np.ptp(cut[0], axis=0) == pytest.approx(np.ptp(plain[0], axis=0) + 0.2, abs=1e-6)


def read_3mf(content: bytes) -> dict[str, Any]:
    """Bodies of a 3MF by name, as lib3mf reads them strictly, as solids in millimetres."""
    lib3mf = pytest.importorskip("lib3mf")
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(content)
    assert reader.GetWarningCount() == 0
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    objects = model.GetMeshObjects()
    assert objects.MoveNext()
    mesh = objects.GetCurrentMeshObject()
    assert not objects.MoveNext(), "more than one object: slicers move them apart"
    assert mesh.IsManifoldAndOriented()
    vertices = np.array([list(v.Coordinates) for v in mesh.GetVertices()], dtype=np.float32)
    triangles = np.array([list(t.Indices) for t in mesh.GetTriangleIndices()], dtype=np.uint32)
    found = {}
    for name, first, last, extruder in volumes_3mf(content):
        material = {mesh.GetTriangleProperties(k).PropertyIDs[0] for k in range(first, last + 1)}
        assert len(material) == 1
        assert extruder == len(found) + 1
        used, rows = np.unique(triangles[first : last + 1], return_inverse=True)
        body = m3.Manifold(m3.Mesh(vertices[used], rows.reshape(-1, 3).astype(np.uint32)))
        assert body.status() == m3.Error.NoError
        found[name] = body
    return found


def volumes_3mf(content: bytes) -> list[tuple[str, int, int, int]]:
    """Name, first and last triangle, and extruder of each volume, as PrusaSlicer is told."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        config = ET.fromstring(archive.read("Metadata/Slic3r_PE_model.config"))
    found = []
    for volume in config.iter("volume"):
        data = {m.get("key"): m.get("value") or "" for m in volume.iter("metadata")}
        found.append(
            (data["name"], int(volume.get("firstid") or 0), int(volume.get("lastid") or 0), int(data["extruder"]))
        )
    return found


def assert_tiled(bodies: dict[str, Any], whole_mm3: float, size: Array) -> None:
    white, black = bodies["white"], bodies["black"]
    assert (white ^ black).volume() == pytest.approx(0, abs=1e-3), "the bodies overlap"
    both = white + black
    assert both.volume() == pytest.approx(white.volume() + black.volume(), rel=1e-6)
    assert both.volume() == pytest.approx(whole_mm3, rel=1e-6), "there is a gap between the bodies"
    low, high = np.array(both.bounding_box()).reshape(2, 3)
    assert high - low == pytest.approx(size, abs=OUTER_MM)


@pytest.mark.slow
@pytest.mark.parametrize("box", BOXES, ids=["default", "small"])
def test_two_colours_tile_the_box(box: Box) -> None:
    build, (w, d, h), target = build_for(box), size_mm(box), make_target(box)
    bodies = read_3mf(box_3mf(target))
    t, tab = build.wall * 1e3, build.tab * 1e3
    whole = w * d * h - (w - 2 * t) * (d - 2 * t) * (h - t) + 4 * tab**3 / 6
    assert_tiled(bodies, whole, size_mm(box))
    ink = sum(ink_area_mm2(target, face) for face in range(4)) * build.line * 1e3
    assert bodies["black"].volume() == pytest.approx(ink, rel=1e-3)
    assert bodies["black"].volume() < ink, "diagonal corners are not parted"
    for face in range(4):
        T_face_box = np.linalg.inv(box.T_box_face(face))
        T_face_box[:3, 3] *= 1e3
        loops = bodies["black"].transform(T_face_box[:3]).slice(-build.line * 500).to_polygons()
        tags_read_from([np.vstack([loop, loop[:1]]) for loop in loops], target, face, np.zeros(2))


@pytest.mark.slow
def test_two_colours_tile_every_panel_and_lie_face_down_in_the_first_layer() -> None:
    target, build = make_target(), Build()
    outlines = {panel.name: panel.outline * 1e3 for panel in panels(target.box, build)}
    files = panels_3mf(target)
    assert set(files) == {f"panel-{name}.3mf" for name in outlines}
    for name, outline in outlines.items():
        bodies = read_3mf(files[f"panel-{name}.3mf"])
        if name == "base":
            assert set(bodies) == {"white"}
            continue
        area = abs(signed_area(np.vstack([outline, outline[:1]])))
        assert_tiled(bodies, area * 3, np.array([*np.ptp(outline, axis=0), 3.0]))
        low, high = np.array(bodies["black"].bounding_box()).reshape(2, 3)
        assert (low[2], high[2]) == pytest.approx((0, build.layer * 1e3), abs=1e-6)
        if name.startswith("face"):
            face = int(name[-1])
            # From below, the bed's x runs against the face's: mirrored, the first layer reads as the face does.
            loops = [loop * (-1, 1) for loop in bodies["black"].slice(build.layer * 500).to_polygons()]
            tags_read_from([np.vstack([loop, loop[:1]]) for loop in loops], target, face, np.zeros(2))


def test_3mf_is_a_package_that_slicers_open() -> None:
    content = panels_3mf(make_target(SMALL), bed=0.256)["panel-face0.3mf"]
    core = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        assert archive.namelist()[0] == "[Content_Types].xml"
        model = ET.fromstring(archive.read("3D/3dmodel.model"))
    colours = [base.get("displaycolor") for base in model.iter(f"{core}base")]
    assert colours == ["#FFFFFFFF", "#000000FF"]
    (item,) = model.iter(f"{core}item")
    assert (item.get("transform") or "").split()[-3:] == ["128", "128", "0"]
    (whole,) = model.iter(f"{core}object")
    assert whole.get("id") == item.get("objectid")
    assert not list(model.iter(f"{core}component"))
    triangles = len(list(whole.iter(f"{core}triangle")))
    (_, first, split, one), (_, after, last, two) = volumes_3mf(content)
    assert (first, after, last) == (0, split + 1, triangles - 1)
    assert (one, two) == (1, 2)
    application = [m.text or "" for m in model.iter(f"{core}metadata") if m.get("name") == "Application"]
    assert "PrusaSlicer" in application[0], "Bambu Studio and OrcaSlicer read the volumes only then"


def test_a_box_too_large_for_the_bed_says_so() -> None:
    files = prints(make_target(LARGE))
    assert list(files) == ["too-large.txt"]
    assert b"500 x 500 x 400 mm" in files["too-large.txt"]


def test_loops_of_the_inlay_touch_nowhere() -> None:
    target = make_target(SMALL)
    points = np.concatenate(tag_loops(target, 0, clip=2e-5))
    assert len(np.unique(points.round(9), axis=0)) == len(points)
    touching = np.concatenate(tag_loops(target, 0))
    assert len(np.unique(touching.round(9), axis=0)) < len(touching), "this face has no diagonal corners to part"


@pytest.mark.parametrize(
    ("build", "complaint"),
    [
        (Build(wall=0.02), "reduce wall"),
        (Build(tab=0.08), "reduce tab"),
        (Build(layer=0.004), "reduce layer"),
        (Build(engraving=0.003), "reduce engraving"),
        (Build(wall=float("nan")), "wall is nan"),
        (Build(finger=0.0), "finger is 0"),
    ],
)
def test_impossible_builds_are_refused_by_name(build: Build, complaint: str) -> None:
    target = make_target(SMALL)
    for make in (box_step, panels_step, box_stls, panels_dxf, box_3mf, panels_3mf):
        with pytest.raises(TargetError, match=complaint):
            make(target, build)


def test_same_target_gives_the_same_bytes() -> None:
    target = make_target(SMALL)
    assert panels_dxf(target) == panels_dxf(target)
    assert net_dxf(target) == net_dxf(target)
    assert box_3mf(target) == box_3mf(target)
    assert box_stls(target) == box_stls(target)
    assert box_step(target) == box_step(target)
    assert panels_step(target) == panels_step(target)
