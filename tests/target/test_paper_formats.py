"""Every format of paper is checked as ink: rendered whole by two renderers, decoded, measured, put together, folded."""

import io
import math
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from reportlab.pdfgen.canvas import Canvas

from boxcal.target.arrays import Array
from boxcal.target.box import Box, Target, make_target
from boxcal.target.errors import TargetError
from boxcal.target.files.target_json import load_target, save_target
from boxcal.target.presets import PRESETS
from boxcal.target.print.ink import FONT, text_width
from boxcal.target.print.net import Net, make_net
from boxcal.target.print.net_pages import net_pages, net_pdf, tiled_net
from boxcal.target.print.page import PRINTABLE_MARGIN
from boxcal.target.print.papers import NET_PAPERS, PAPERS
from boxcal.target.print.sheets import face_tiles, sheets_pdf, tiled_pdf
from boxcal.target.print.strips import Rect
from boxcal.target.print.tiles import OVERLAP, tile_cuts, tiles
from boxcal.target.tags.families import dictionary_names, tag_modules

Grey = NDArray[np.uint8]
Renderer = Callable[[Path, int, int], Grey]

INCH = 0.0254
EXACT = 1e-5
"""How far a printed corner may lie from target.json, m."""
LARGE: dict[str, Any] = dict(PRESETS["large"].figures)


def poppler_page(pdf: Path, page: int, dpi: int) -> Grey:
    """Render a page with poppler's Cairo back end: its edge pixels are as grey as they are covered."""
    number = str(page + 1)
    command = ["pdftocairo", "-png", "-gray", "-singlefile", "-f", number, "-l", number, "-r", str(dpi), str(pdf), "-"]
    png = subprocess.run(command, check=True, capture_output=True).stdout
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def pdfium_page(pdf: Path, page: int, dpi: int) -> Grey:
    import pypdfium2  # noqa: PLC0415 - an extra of development

    with pypdfium2.PdfDocument(pdf) as document:
        # It stretches a page to whole pixels: make it whole pixels first (less a hair, for it rounds up).
        width, height = document[page].get_size()
        columns, rows = (math.ceil(side * dpi / 72 - 0.01) for side in (width, height))
        document[page].set_mediabox(0, height - (rows - 0.005) * 72 / dpi, (columns - 0.005) * 72 / dpi, height)
        image = np.array(document[page].render(scale=dpi / 72, grayscale=True).to_numpy())
    assert image.shape[:2] == (rows, columns)
    return image.reshape(rows, columns)


@pytest.fixture(params=["poppler", "pdfium"])
def render(request: pytest.FixtureRequest) -> Renderer:
    if request.param == "pdfium":
        pytest.importorskip("pypdfium2", reason="needs the renderer pypdfium2")
        return pdfium_page
    if shutil.which("pdftocairo") is None:
        pytest.skip("needs pdftocairo (poppler-utils)")
    return poppler_page


def measured_corners(image: Grey, left: float, top: float, side: float, modules: NDArray[np.bool_]) -> Array:
    """Return a tag's corners, (4, 2) px, from the ink of its border near where it should be; check all its modules.

    Every edge is measured along two lines through the middle of the border's outer modules.
    """
    count = modules.shape[0]
    module = side / count
    x0, y0, size = round(left - 0.8 * module), round(top - 0.8 * module), round(side + 1.6 * module)
    assert min(x0, y0) >= 0
    ink = 1 - image[y0 : y0 + size, x0 : x0 + size] / 255
    assert ink.shape == (size, size)
    centres = ((np.arange(count) + 0.5) * module).astype(int)
    read = image[np.ix_((centres + top).astype(int), (centres + left).astype(int))]
    assert np.array_equal(read > 127, modules), "another tag stands here"
    near, far = int(1.3 * module), size - int(1.3 * module)

    def ends(line: Array) -> tuple[float, float]:
        assert line[0] == line[-1] == 0, "a tag has no white border"
        middle = size // 2
        return middle - float(line[:middle].sum()), middle + float(line[middle:].sum())

    (left_top, right_top), (left_bottom, right_bottom) = ends(ink[near]), ends(ink[far])
    (top_left, bottom_left), (top_right, bottom_right) = ends(ink[:, near]), ends(ink[:, far])
    corners = [(left_top, top_left), (right_top, top_right), (right_bottom, bottom_right), (left_bottom, bottom_left)]
    return np.array(corners) + np.array([x0, y0])


@dataclass(frozen=True, kw_only=True)
class FaceOnPage:
    """A face on a page of a height (m): its centre, m from the bottom left, and what part of it is to stay."""

    page: int
    height: float
    face: int
    centre: tuple[float, float]
    stays: Rect | None = None

    def tags(self, target: Target) -> Iterator[tuple[int, Array]]:
        """Ids with their designed corners on the page, (4, 2) m, of the tags in the part that stays."""
        grid = target.box.grid_corners() + self.centre
        for tag_id, corners in zip(target.tag_ids[target.tag_faces == self.face], grid, strict=True):
            (left, bottom), (right, top), p = corners.min(axis=0), corners.max(axis=0), self.stays
            if p is None or (left > p.left and right < p.right and bottom > p.bottom and top < p.top):
                yield int(tag_id), corners


def measured_on_page(image: Grey, dpi: int, target: Target, at: FaceOnPage, *, decode: bool) -> dict[int, Array]:
    """Return the corners of all tags of a face on a page, (4, 2) m from the face's centre by id, read from its ink."""
    side = target.box.tag_size / INCH * dpi
    wanted = dict(at.tags(target))
    down = np.array([1, -1])
    origin = np.array([0, at.height])
    found = {}
    for tag_id, corners in wanted.items():
        left, top = (corners[0] * down + origin) / INCH * dpi
        pixels = measured_corners(image, left, top, side, tag_modules(target.box.dictionary, tag_id))
        found[tag_id] = (pixels / dpi * INCH - origin) * down - at.centre
    if decode:
        # Large pages are halved for the detector, whose time goes by pixels.
        shrink = 2 if image.size > 12_000_000 else 1
        small = cv2.resize(image, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
        family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.box.dictionary))
        seen_corners, ids, _ = cv2.aruco.ArucoDetector(family).detectMarkers(small)
        seen = dict(zip(np.ravel(ids).tolist(), (np.reshape(c, (4, 2)) for c in seen_corners), strict=True))
        assert set(wanted) <= set(seen)
        for tag_id, corners in wanted.items():
            pixels = (corners * down + origin) / INCH * dpi / shrink - 0.5
            assert np.abs(seen[tag_id] - pixels).max() < 2, f"tag {tag_id} is turned or elsewhere"
    return found


def on_sheets(target: Target, paper: str) -> list[FaceOnPage]:
    """Faces in the middle of their pages."""
    box, size = target.box, PAPERS[paper]
    pages = []
    for face in range(4):
        flat = box.face_width(face) >= box.height
        width, height = (size.long, size.short) if flat else (size.short, size.long)
        pages.append(FaceOnPage(page=face, height=height, face=face, centre=(width / 2, height / 2)))
    return pages


def on_tiles(target: Target, paper: str) -> list[FaceOnPage]:
    """Faces of a box on the pages of their tiles, only what stays when the joints are cut."""
    pages = []
    page = 0
    for face, (drawing, parts) in enumerate(face_tiles(target, PAPERS[paper])):
        c = drawing.content
        middle = (c.left + c.right) / 2, (c.bottom + c.top) / 2
        for tile in parts:
            dx, dy = tile.shift
            t = tile.trim
            stays = Rect(left=t.left + dx, right=t.right + dx, bottom=t.bottom + dy, top=t.top + dy)
            centre = (middle[0] + dx, middle[1] + dy)
            pages.append(FaceOnPage(page=page, height=tile.height, face=face, centre=centre, stays=stays))
            page += 1
    return pages


def on_nets(target: Target, paper: str) -> list[FaceOnPage]:
    """Faces on the pages of a net, in one piece, in halves or in tiles."""
    found = net_pages(target, NET_PAPERS[paper])
    if found is not None:
        return [
            FaceOnPage(page=i, height=page.height, face=part.face, centre=(part.centre[0] + x, part.centre[1] + y))
            for i, page in enumerate(found)
            for net, (x, y) in page.nets
            for part in net.faces
        ]
    pages = []
    faces = make_net(target.box, base_on=None, lid_on=None).faces
    for tile in tiles(tiled_net(target, NET_PAPERS[paper]), NET_PAPERS[paper]):
        dx, dy = tile.shift
        t = tile.trim
        stays = Rect(left=t.left + dx, right=t.right + dx, bottom=t.bottom + dy, top=t.top + dy)
        for part in faces:
            centre = (part.centre[0] + dx, part.centre[1] + dy)
            pages.append(
                FaceOnPage(page=tile.index - 1, height=tile.height, face=part.face, centre=centre, stays=stays)
            )
    return pages


FORMATS: dict[str, tuple[dict[str, Any], Callable[[Target], bytes], Callable[[Target], list[FaceOnPage]]]] = {
    "a4": ({}, lambda t: sheets_pdf(t, PAPERS["a4"]), lambda t: on_sheets(t, "a4")),
    "letter": ({}, lambda t: sheets_pdf(t, PAPERS["letter"]), lambda t: on_sheets(t, "letter")),
    "a3": ({}, lambda t: sheets_pdf(t, PAPERS["a3"]), lambda t: on_sheets(t, "a3")),
    "a3-tiles": (LARGE, lambda t: tiled_pdf(t, PAPERS["a3"]), lambda t: on_tiles(t, "a3")),
    "a4-tiles": (LARGE, lambda t: tiled_pdf(t, PAPERS["a4"]), lambda t: on_tiles(t, "a4")),
    "letter-tiles": (LARGE, lambda t: tiled_pdf(t, PAPERS["letter"]), lambda t: on_tiles(t, "letter")),
    "net-a1": ({}, lambda t: net_pdf(t, NET_PAPERS["a1"])[0], lambda t: on_nets(t, "a1")),
    "net-a2": ({}, lambda t: net_pdf(t, NET_PAPERS["a2"])[0], lambda t: on_nets(t, "a2")),
    "net-a4": ({}, lambda t: net_pdf(t, NET_PAPERS["a4"])[0], lambda t: on_nets(t, "a4")),
}


def check_format(name: str, render: Renderer, folder: Path, dpi: int, *, pages: int, decode: bool) -> set[int]:
    """Render the first pages of a format, hold every corner against target.json; return the ids that were found."""
    figures, make, layout = FORMATS[name]
    target = make_target(Box(**figures))
    save_target(target, folder / "target.json")
    target = load_target(folder / "target.json")
    pdf = folder / f"{name}.pdf"
    pdf.write_bytes(make(target))
    images: dict[int, Grey] = {}
    found: list[int] = []
    for at in layout(target):
        if at.page >= pages:
            continue
        if at.page not in images:
            images = {at.page: render(pdf, at.page, dpi)}
        T = target.box.T_box_face(at.face)
        for tag_id, corners in measured_on_page(images[at.page], dpi, target, at, decode=decode).items():
            p_box = np.column_stack([corners, np.zeros(4)]) @ T[:3, :3].T + T[:3, 3]
            off = np.abs(p_box - target.tag_corners[target.row_of(tag_id)]).max()
            assert off < EXACT, f"tag {tag_id} lies {off * 1e3:.4f} mm off"
            found.append(tag_id)
    assert len(found) == len(set(found)), "a tag stays on two tiles"
    return set(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_carries_every_tag_of_target_json_in_its_place_at_300_dpi(
    name: str, render: Renderer, tmp_path: Path
) -> None:
    # Six tiles make one face of the large box; its other faces are other tags in the same tiles.
    pages = 6 if name in {"a4-tiles", "letter-tiles"} else 1000
    # OpenCV reads the ink of one renderer; the modules of every tag are compared in both.
    found = check_format(name, render, tmp_path, 300, pages=pages, decode=render is pdfium_page)
    box = Box(**FORMATS[name][0])
    assert found == set(range(box.tags_a_face if pages == 6 else 4 * box.tags_a_face))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a4", "letter", "a3", "a3-tiles", "a4-tiles", "net-a2", "net-a4"])
def test_the_first_page_of_every_kind_is_exact_at_600_dpi(name: str, tmp_path: Path) -> None:
    """By one renderer: both are compared at 300 dpi, to the same hundredth of a millimetre."""
    pytest.importorskip("pypdfium2", reason="needs the renderer pypdfium2")
    assert check_format(name, pdfium_page, tmp_path, 600, pages=1, decode=False)


def test_one_format_at_150_dpi_is_exact_too(tmp_path: Path) -> None:
    pytest.importorskip("pypdfium2", reason="needs the renderer pypdfium2")
    assert len(check_format("a3-tiles", pdfium_page, tmp_path, 150, pages=1, decode=True)) == 24


@pytest.mark.parametrize("dictionary", dictionary_names())
def test_tags_of_any_family_are_printed_as_opencv_reads_them(dictionary: str, tmp_path: Path) -> None:
    pytest.importorskip("pypdfium2", reason="needs the renderer pypdfium2")
    target = make_target(Box(columns=2, rows=2, tag_size=0.05, pitch=0.07, dictionary=dictionary))
    pdf = tmp_path / "sheets.pdf"
    pdf.write_bytes(sheets_pdf(target, PAPERS["a4"]))
    at = on_sheets(target, "a4")[2]
    found = measured_on_page(pdfium_page(pdf, at.page, 100), 100, target, at, decode=True)
    assert sorted(found) == [8, 9, 10, 11]


def dark_columns(image: Grey, row: int, first: int, last: int) -> Array:
    """Return where thin lines cross a row of pixels, as the centres of their ink."""
    ink = 1 - image[row, first:last] / 255.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], ink > 0.02, [0]])))
    return np.array([first + 0.5 + np.average(np.arange(a, b), weights=ink[a:b]) for a, b in edges.reshape(-1, 2)])


def test_tiles_laid_line_on_line_keep_the_pitch_across_their_joint(render: Renderer, tmp_path: Path) -> None:
    """Measured from the ink alone: dashed line on the left tile, solid line on the right one, tags beside both."""
    dpi = 600
    target = make_target(Box(**LARGE))
    pdf = tmp_path / "tiles.pdf"
    pdf.write_bytes(tiled_pdf(target, PAPERS["a3"]))
    left, right = on_tiles(target, "a3")[:2]
    gaps = []
    for at, outer in ((left, "right"), (right, "left")):
        image = render(pdf, at.page, dpi)
        assert at.stays is not None
        line_px = getattr(at.stays, outer) / INCH * dpi
        corners = measured_on_page(image, dpi, target, at, decode=False)
        edge = (max if outer == "right" else min)(
            float(c[:, 0].max() if outer == "right" else c[:, 0].min()) for c in corners.values()
        )
        row = next(
            r
            for r in range(image.shape[0] // 2, image.shape[0])
            if dark_columns(image, r, int(line_px) - 20, int(line_px) + 20).size
        )
        drawn = dark_columns(image, row, int(line_px) - 20, int(line_px) + 20)
        assert drawn.size == 1
        gaps.append(abs(float(drawn[0]) / dpi * INCH - (edge + at.centre[0])))
    assert sum(gaps) == pytest.approx(target.box.pitch - target.box.tag_size, abs=EXACT)


def test_registration_marks_of_neighbours_are_the_same_spots_of_the_face() -> None:
    for paper in ("a3", "a4"):
        for drawing, parts in face_tiles(make_target(Box(**LARGE)), PAPERS[paper]):
            by_place = {(t.row, t.column): t for t in parts}
            assert [t.index for t in parts] == list(range(1, len(parts) + 1))
            for (row, column), tile in by_place.items():
                beside, below = by_place.get((row, column + 1)), by_place.get((row + 1, column))
                if beside is not None:
                    assert beside.trim.left == tile.trim.right
                    assert tile.printed.right == pytest.approx(tile.trim.right + OVERLAP)
                    assert (beside.printed.top, beside.printed.bottom) == (tile.printed.top, tile.printed.bottom)
                if below is not None:
                    assert below.trim.top == tile.trim.bottom
                    assert (below.printed.left, below.printed.right) == (tile.printed.left, tile.printed.right)
                x, y = tile.shift
                p = tile.printed
                assert min(p.left + x, p.bottom + y, tile.width - p.right - x, tile.height - p.top - y) >= (
                    PRINTABLE_MARGIN + 0.006 - 1e-9
                )
            area = sum(t.trim.width * t.trim.height for t in parts)
            assert area == pytest.approx(drawing.content.width * drawing.content.height)


@settings(max_examples=200, deadline=None)
@given(
    steps=st.lists(st.floats(0.01, 0.08), min_size=1, max_size=25),
    space=st.floats(0.05, 0.4),
)
def test_cuts_lie_on_joints_and_every_tile_fits_with_its_overlap(steps: list[float], space: float) -> None:
    places = np.cumsum([0.0, *steps])
    joints = tuple(float(p) for p in places[1:-1])
    cuts = tile_cuts((0.0, float(places[-1])), joints, space)
    if cuts is None:
        widest = max(max(steps[:-1], default=0.0) + OVERLAP, steps[-1])
        assert widest > space - 1e-8
        return
    assert set(cuts[1:-1]) <= set(joints)
    assert (cuts[0], cuts[-1]) == (0.0, float(places[-1]))
    for a, b in pairwise(cuts):
        assert b - a + (OVERLAP if b < cuts[-1] else 0) <= space + 1e-8
    assert len(cuts) - 1 >= (places[-1] - OVERLAP) / space - 1e-6


def test_a_tag_that_no_tile_can_hold_is_refused_with_the_figure_to_change() -> None:
    box = Box(width=0.9, depth=0.9, height=0.9, columns=2, rows=2, tag_size=0.35, pitch=0.44)
    with pytest.raises(TargetError, match=r"A4: Face 0 cannot be cut between its tags into tiles .*; reduce tag_size"):
        tiled_pdf(make_target(box), PAPERS["a4"])
    with pytest.raises(TargetError, match="A4: Net cannot be cut between its tags"):
        net_pdf(make_target(box), NET_PAPERS["a4"])


@pytest.mark.parametrize("paper", ["a4", "letter", "a3"])
@pytest.mark.parametrize(
    "figures",
    [
        {"width": 0.6, "depth": 0.4, "height": 0.3},
        {"width": 0.3, "depth": 0.3, "height": 0.5, "columns": 4, "rows": 7, "tag_size": 0.06, "pitch": 0.068},
        {"width": 0.252, "depth": 0.252, "height": 0.205, "tag_size": 0.03},
        {"width": 0.33, "depth": 0.33, "height": 0.33, "columns": 2, "rows": 2, "tag_size": 0.12, "pitch": 0.16},
    ],
    ids=["oblong", "upright, narrow gaps", "no rim", "few large tags"],
)
def test_boxes_of_other_figures_can_be_tiled(paper: str, figures: dict[str, Any]) -> None:
    target = make_target(Box(**figures))
    for drawing, parts in face_tiles(target, PAPERS[paper]):
        across = {round(t.trim.left, 9) for t in parts if t.column > 0}
        middle = (drawing.content.left + drawing.content.right) / 2
        grid = target.box.grid_corners()[..., 0] + middle
        for x in across:
            clear = np.minimum(np.abs(grid.min(axis=1) - x), np.abs(grid.max(axis=1) - x)).min()
            assert clear >= (target.box.pitch - target.box.tag_size) / 2 - 1e-9
            assert not np.any((grid.min(axis=1) < x) & (x < grid.max(axis=1)))
    assert tiled_pdf(target, PAPERS[paper]).startswith(b"%PDF")


def folded(net: Net, box: Box, face: int) -> Array:
    """Fold a net about its own fold lines, face after face; return where a face's plane comes to lie, (4, 4)."""
    first = net.faces[0]
    start = box.T_box_face(first.face)
    T = np.eye(4)
    T[:3, :3] = start[:3, :3]
    T[:3, 3] = start[:3, 3] - start[:3, :3] @ np.array([*first.centre, 0.0])
    upright = sorted(a[0] for a, b in net.folds if a[0] == b[0])
    for part, hinge in zip(net.faces, [None, *upright], strict=False):
        if hinge is not None:
            # All to the right of the hinge turns backwards by a right angle.
            fold = np.array([[0.0, 0, 1, hinge], [0, 1, 0, 0], [-1, 0, 0, hinge], [0, 0, 0, 1]])
            T = T @ fold
        if part.face == face:
            return T
    raise AssertionError(face)


@pytest.mark.parametrize("figures", [{}, {"width": 0.3, "depth": 0.26}], ids=["default", "oblong"])
@pytest.mark.parametrize("faces", [(0, 1, 2, 3), (2, 3), (3, 0, 1)])
def test_a_folded_net_gives_the_corners_of_target_json(figures: dict[str, Any], faces: tuple[int, ...]) -> None:
    target = make_target(Box(**figures))
    net = make_net(target.box, faces)
    for part in net.faces:
        p_net = target.box.grid_corners() + part.centre
        p = np.concatenate([p_net, np.zeros((*p_net.shape[:2], 1)), np.ones((*p_net.shape[:2], 1))], axis=2)
        p_box = (p @ folded(net, target.box, part.face).T)[..., :3]
        assert np.abs(p_box - target.tag_corners[target.tag_faces == part.face]).max() < 1e-12


def test_a_folded_net_closes_and_its_base_and_lid_close_the_box() -> None:
    box = Box(width=0.3, depth=0.26, height=0.21)
    net = make_net(box)
    left, right = net.faces[0], net.faces[-1]
    ends = [
        folded(net, box, part.face) @ (*part.corners[k], 0, 1)
        for part, k in ((left, 0), (right, 1), (left, 3), (right, 2))
    ]
    assert np.allclose(ends[0], ends[1], atol=1e-12)
    assert np.allclose(ends[2], ends[3], atol=1e-12)
    for kind in ("base", "lid"):
        (part,) = (p for p in net.parts if p.kind == kind)
        xs, ys = zip(*part.corners, strict=True)
        assert max(xs) - min(xs) == pytest.approx(box.face_width(1))
        assert max(ys) - min(ys) == pytest.approx(box.face_width(0))


def polygon_area(corners: tuple[tuple[float, float], ...]) -> float:
    x, y = np.array(corners).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("base_on", [None, 1])
def test_the_outline_of_a_net_goes_once_around_all_its_parts(base_on: int | None) -> None:
    net = make_net(Box(), base_on=base_on, lid_on=base_on)
    assert all(polygon_area(part.corners) > 0 for part in net.parts), "anticlockwise"
    assert polygon_area(net.cut) == pytest.approx(sum(polygon_area(part.corners) for part in net.parts))
    assert len(net.folds) == 4 + 2 * 4, "three between faces, one to the seam, one above and below each face"


def test_a_net_of_faces_that_do_not_meet_is_refused() -> None:
    for faces in ((0, 2), (1, 0), ()):
        with pytest.raises(TargetError, match="a net needs neighbours from left to right"):
            make_net(Box(), faces)


@pytest.mark.parametrize(
    ("paper", "pieces"),
    [
        ("a0", "1 page of A0, the net in one piece with base"),
        ("a1", "2 pages of A1, the net in 2 pieces with base"),
        ("a2", "2 pages of A2, the net in 2 pieces with flaps"),
        ("a3", "3 pages of A3, the net with flaps only in tiles"),
    ],
)
def test_a_net_is_cut_no_more_than_its_paper_asks(paper: str, pieces: str) -> None:
    pdf, what = net_pdf(make_target(), NET_PAPERS[paper])
    assert pieces in what
    assert pdf.startswith(b"%PDF")


@pytest.mark.parametrize("paper", NET_PAPERS)
def test_marks_of_a_net_keep_off_its_faces_and_inside_the_printable_page(paper: str) -> None:
    target = make_target()
    pages = net_pages(target, NET_PAPERS[paper])
    for page in pages or ():
        marks = [slot.area for slot in (page.bar_across, page.bar_up, page.notes)]
        for i, mark in enumerate(marks):
            assert (
                min(mark.left, mark.bottom, page.width - mark.right, page.height - mark.top) >= PRINTABLE_MARGIN - 1e-9
            )
            assert not any(mark.overlaps(other) for other in marks[:i])
            for net, (x, y) in page.nets:
                for part in net.parts:
                    if part.kind in {"base", "lid"}:
                        continue
                    xs, ys = zip(*part.corners, strict=True)
                    area = Rect(left=min(xs) + x, right=max(xs) + x, bottom=min(ys) + y, top=max(ys) + y)
                    if part.kind == "face":  # marks stand on its rim, off the tags' white borders
                        area = Rect(
                            left=area.left + 0.0025,
                            right=area.right - 0.0025,
                            bottom=area.bottom + 0.0125,
                            top=area.top - 0.0125,
                        )
                    assert not mark.overlaps(area)


@pytest.mark.parametrize("paper", ["a4", "letter", "a3"])
def test_tiles_of_a_net_cut_no_words(paper: str, monkeypatch: pytest.MonkeyPatch) -> None:
    target = make_target()
    drawing = tiled_net(target, NET_PAPERS[paper])
    cuts = [tile.trim.left for tile in tiles(drawing, NET_PAPERS[paper]) if tile.column > 0]
    written = []

    def note(_: object, at: tuple[float, float], text: str, **how: Any) -> None:
        half = text_width(text, how.get("font", FONT), how["size"]) / 2
        if not how.get("angle_deg"):
            written.append((at[0] - half, at[0] + half, text))

    monkeypatch.setattr("boxcal.target.print.net_pages.draw_text", note)
    drawing.draw(Canvas(io.BytesIO()))
    assert sum(text.startswith("Face") for *_, text in written) == 4
    assert sum("glue inside" in text for *_, text in written) == 8
    for low, high, text in written:
        assert not any(low < cut < high for cut in cuts), text
