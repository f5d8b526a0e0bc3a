"""The sheets are checked as ink: rendered by two independent renderers, then measured."""

import base64
import math
import re
import shutil
import subprocess
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import event, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from boxcal.target.box import Box, Target, make_target
from boxcal.target.errors import TargetError
from boxcal.target.files.target_json import load_target, save_target, target_sha256
from boxcal.target.print.marks import notes_thickness
from boxcal.target.print.page import PRINTABLE_MARGIN, Page, lay_out
from boxcal.target.print.papers import PAPERS
from boxcal.target.print.sheets import sheets_pdf
from boxcal.target.print.strips import Rect
from boxcal.target.tags.families import modules_per_side, tag_modules

Grey = NDArray[np.uint8]
Crop = tuple[int, int, int, int]
"""Left, top, width and height of a part of a page, in pixels of the whole."""
Renderer = Callable[[Path, int, int, Crop], Grey]
"""Renders a part of a face's page: (pdf, face, dots per inch, part)."""

MM = 1e-3
DPI = 1200
PAGE_MM = {"a4": (297.0, 210.0), "letter": (279.4, 215.9)}
SIZE_TOLERANCE = 0.02 * MM


def render_with_poppler(pdf: Path, face: int, dpi: int, crop: Crop) -> Grey:
    page = ["-f", str(face + 1), "-l", str(face + 1), "-r", str(dpi), "-gray"]
    part = [text for name, value in zip(("-x", "-y", "-W", "-H"), crop, strict=True) for text in (name, str(value))]
    pgm = subprocess.run(["pdftoppm", *page, *part, str(pdf)], check=True, capture_output=True).stdout
    header = re.match(rb"P5\s+(\d+)\s+(\d+)\s+255\s", pgm)
    assert header is not None
    return np.frombuffer(pgm, np.uint8, offset=header.end()).reshape(int(header[2]), int(header[1]))


def render_with_pdfium(pdf: Path, face: int, dpi: int, crop: Crop) -> Grey:
    import pypdfium2  # noqa: PLC0415 - an extra of development

    left, top, width, height = crop
    with pypdfium2.PdfDocument(pdf) as document:
        # It stretches a page to whole pixels: make it whole pixels first (less a hair, for it rounds up).
        page_width, page_height = (math.ceil(side * dpi / 72 - 0.01) for side in document[face].get_size())
        page_top = document[face].get_height()
        right, bottom = (page_width - 0.005) * 72 / dpi, page_top - (page_height - 0.005) * 72 / dpi
        document[face].set_mediabox(0, bottom, right, page_top)
        page = document[face]
        # What is cut off is rounded up to whole pixels.
        cut_px = (left, page_height - top - height, page_width - left - width, top)
        cut = tuple(max(0, c - 0.5) * 72 / dpi for c in cut_px)
        image = np.array(page.render(scale=dpi / 72, crop=cut, grayscale=True).to_numpy())
    assert image.shape[:2] == (height, width)
    return image.reshape(image.shape[:2])


@pytest.fixture(params=["poppler", "pdfium"])
def render(request: pytest.FixtureRequest) -> Renderer:
    if request.param == "pdfium":
        pytest.importorskip("pypdfium2", reason="needs the renderer pypdfium2")
        return render_with_pdfium
    if shutil.which("pdftoppm") is None:
        pytest.skip("needs pdftoppm (poppler-utils)")
    return render_with_poppler


@pytest.fixture(scope="module", params=["a4", "letter"])
def paper(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def pdf(paper: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sheets") / f"box-{paper}.pdf"
    path.write_bytes(sheets_pdf(make_target(), PAPERS[paper]))
    return path


def px(length: float, dpi: int = DPI) -> float:
    return length / 0.0254 * dpi


def designed_tags(paper: str, face: int) -> Iterator[tuple[int, float, float]]:
    """Ids with the page position of their top left corner, m right and m down, from the drawing of the default box."""
    page_width, page_height = (side * MM for side in PAGE_MM[paper])
    for row in range(5):
        for column in range(7):
            x = page_width / 2 + ((column - 3) * 35 - 14) * MM
            y = page_height / 2 + ((row - 2) * 35 - 14) * MM
            yield 35 * face + 7 * row + column, x, y


def render_tag(render: Renderer, pdf: Path, face: int, x: float, y: float) -> tuple[Grey, float, float]:
    """Return a picture of a tag with 1.5 modules of its surroundings, and the page pixel of its first pixel."""
    border = 1.5 * 3.5 * MM
    left, top, size = int(px(x - border)), int(px(y - border)), int(px(28 * MM + 2 * border)) + 1
    return render(pdf, face, DPI, (left, top, size, size)), left, top


def edges_px(ink: NDArray[np.float64]) -> tuple[float, float]:
    """Return where a run of black along a line begins and ends, in pixels from the line's start, from its coverage."""
    middle = ink.size // 2
    assert ink[0] == 0
    assert ink[-1] == 0
    return middle - float(ink[:middle].sum()), middle + float(ink[middle:].sum())


def measured_corners(image: Grey) -> NDArray[np.float64]:
    """Return a tag's corners in pixels of its picture, from its black border alone (no figure of the design but 8)."""
    ink = 1 - image / 255
    side = int(px(28 * MM))
    # Every edge is measured along lines through the middle of the border's outer module next to each corner.
    near = (image.shape[0] - side) // 2 + side // 16
    far = image.shape[0] - near
    (left_top, right_top), (left_bottom, right_bottom) = edges_px(ink[near]), edges_px(ink[far])
    (top_left, bottom_left), (top_right, bottom_right) = edges_px(ink[:, near]), edges_px(ink[:, far])
    return np.array(
        [(left_top, top_left), (right_top, top_right), (right_bottom, bottom_right), (left_bottom, bottom_left)]
    )


def wrong_pixels(image: Grey, modules: NDArray[np.bool_], left: float, top: float, edge_px: int = 3) -> int:
    """Return how many pixels further than ``edge_px`` from any black-white edge are not fully black or white.

    ``modules`` are those of the tag (true is white) and ``left, top`` its top left corner in the picture; around it
    one module of white is wanted.
    """
    module = px(28 * MM) / modules.shape[0]
    wanted = np.pad(modules, 2, constant_values=True)
    columns, rows = (
        np.floor((np.arange(n) + 0.5 - first) / module).astype(int) + 2
        for n, first in ((image.shape[1], left), (image.shape[0], top))
    )
    white = wanted[np.ix_(rows, columns)].astype(np.uint8)
    kernel = np.ones((2 * edge_px + 1,) * 2, dtype=np.uint8)
    surely_white, surely_black = cv2.erode(white, kernel) > 0, cv2.dilate(white, kernel) == 0
    return int(np.sum(image[surely_white] != 255) + np.sum(image[surely_black] != 0))


def check_tags(render: Renderer, pdf: Path, paper: str, *, face: int, target: Target, every: int) -> None:
    page_width, page_height = (side * MM for side in PAGE_MM[paper])
    T = target.box.T_box_face(face)
    for tag_id, x, y in list(designed_tags(paper, face))[::every]:
        image, left, top = render_tag(render, pdf, face, x, y)
        modules = tag_modules(target.box.dictionary, tag_id)
        assert wrong_pixels(image, modules, px(x) - left, px(y) - top) == 0, f"seam or stain in tag {tag_id}"
        corners = measured_corners(image)
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1) / DPI * 0.0254
        assert np.all(np.abs(sides - 0.028) < SIZE_TOLERANCE), f"tag {tag_id} measures {sides}"
        page = (corners + np.array([left, top])) / DPI * 0.0254
        p_face = np.column_stack([page[:, 0] - page_width / 2, page_height / 2 - page[:, 1], np.zeros(4)])
        p_box = p_face @ T[:3, :3].T + T[:3, 3]
        wanted = target.tag_corners[target.row_of(tag_id)]
        assert np.abs(p_box - wanted).max() < SIZE_TOLERANCE, f"tag {tag_id} lies {p_box - wanted} off"


@pytest.mark.slow
def test_folded_sheets_carry_tags_of_target_json_without_a_seam(
    render: Renderer, pdf: Path, paper: str, tmp_path: Path
) -> None:
    save_target(make_target(), tmp_path / "target.json")
    target = load_target(tmp_path / "target.json")
    for face in range(4):
        check_tags(render, pdf, paper, face=face, target=target, every=4)


def test_some_tags_of_a_sheet_are_exact_in_size_and_place_and_without_a_seam(
    render: Renderer, pdf: Path, paper: str
) -> None:
    check_tags(render, pdf, paper, face=3, target=make_target(), every=17)


def test_the_seam_check_sees_a_faint_line_of_one_pixel() -> None:
    modules = tag_modules("DICT_APRILTAG_36h11", 0)
    side = round(px(28 * MM))
    nearest = (np.arange(side) + 0.5) * 8 // side
    image = np.where(modules[np.ix_(nearest.astype(int), nearest.astype(int))], 255, 0).astype(np.uint8)
    image = np.pad(image, 200, constant_values=255)
    assert wrong_pixels(image, modules, 200, 200) == 0
    in_black = image.copy()
    in_black[200 + side // 16, 210:900] = 8
    assert wrong_pixels(in_black, modules, 200, 200) > 600
    in_white = image.copy()
    in_white[300:900, 100] = 247
    assert wrong_pixels(in_white, modules, 200, 200) == 600


def test_the_measure_of_a_tag_sees_a_hundredth_of_a_millimetre() -> None:
    scale = 1 + 0.01 / 28
    side = px(28 * MM * scale)
    coverage = np.clip(np.minimum(np.arange(1800) + 1 - 200, 200 + side - np.arange(1800)), 0, 1)
    image = (255 * (1 - np.outer(coverage, coverage))).round().astype(np.uint8)[: int(400 + side), : int(400 + side)]
    corners = measured_corners(image)
    assert np.linalg.norm(corners[1] - corners[0]) / DPI * 0.0254 == pytest.approx(0.02801, abs=1e-6)


@pytest.mark.parametrize("face", range(4))
def test_every_tag_is_found_upright_at_its_place(render: Renderer, pdf: Path, paper: str, face: int) -> None:
    dpi = 150
    width, height = (round(px(side * MM, dpi)) for side in PAGE_MM[paper])
    image = render(pdf, face, dpi, (0, 0, width, height))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(image)
    found = dict(zip(np.ravel(ids).tolist(), (np.reshape(c, (4, 2)) for c in corners), strict=True))
    designed = {tag_id: (x, y) for tag_id, x, y in designed_tags(paper, face)}
    assert set(found) == set(designed)
    for tag_id, (x, y) in designed.items():
        wanted = np.array([(x, y), (x + 0.028, y), (x + 0.028, y + 0.028), (x, y + 0.028)]) / 0.0254 * dpi - 0.5
        assert np.abs(found[tag_id] - wanted).max() < 1.5


def test_scale_bars_are_100_mm_long_both_ways(render: Renderer, pdf: Path, paper: str) -> None:
    for face in range(4):
        page = page_of(Box(), face, paper)
        for slot in (page.bar_across, page.bar_up):
            area = slot.area
            left, top = int(px(area.left)) - 20, int(px(page.height - area.top)) - 20
            image = render(pdf, face, DPI, (left, top, int(px(area.width)) + 40, int(px(area.height)) + 40))
            ink = 1 - image / 255
            across = ink.sum(axis=1 if slot.turned else 0)
            ticks = np.flatnonzero(across > 0.9 * px(area.width if slot.turned else area.height))
            centre = np.arange(across.size) + 0.5
            first, last = ticks < across.size / 2, ticks > across.size / 2
            ends = [np.average(centre[ticks[half]], weights=across[ticks[half]]) for half in (first, last)]
            assert (ends[1] - ends[0]) / DPI * 25.4 == pytest.approx(100, abs=0.02)


def test_nothing_but_the_outline_stands_where_printers_do_not_print(render: Renderer, pdf: Path, paper: str) -> None:
    dpi = 300
    width, height = (round(px(side * MM, dpi)) for side in PAGE_MM[paper])
    for face in range(4):
        image = render(pdf, face, dpi, (0, 0, width, height)).copy()
        half = px(0.125, dpi), px(0.1, dpi)
        outline = np.zeros(image.shape, dtype=bool)
        corners = [tuple(round(c + s * h) for c, h in zip((width / 2, height / 2), half, strict=True)) for s in (-1, 1)]
        (left, top), (right, bottom) = corners
        for band in (
            np.s_[top - 3 : top + 3, left - 3 : right + 3],
            np.s_[bottom - 3 : bottom + 3, left - 3 : right + 3],
        ):
            outline[band] = True
        for band in (
            np.s_[top - 3 : bottom + 3, left - 3 : left + 3],
            np.s_[top - 3 : bottom + 3, right - 3 : right + 3],
        ):
            outline[band] = True
        assert image[outline].min() < 200, "the outline is not where the face ends"
        assert np.all(image[top : top + 1, : left - 6] == 255)
        image[outline] = 255
        inside = round(px(PRINTABLE_MARGIN, dpi)) - 2
        assert image[inside:-inside, inside:-inside].min() == 0
        image[inside:-inside, inside:-inside] = 255
        assert image.min() == 255


def page_of(box: Box, face: int, paper: str) -> Page:
    return lay_out(box, face, PAPERS[paper], notes_thickness("x" * 60 + " " + "y" * 60))


def distance(one: Rect, other: Rect) -> float:
    """Return how far two rectangles are apart along the axis that parts them most (negative if they overlap)."""
    return max(one.left - other.right, other.left - one.right, one.bottom - other.top, other.bottom - one.top)


@settings(max_examples=400, deadline=None)
@given(
    paper=st.sampled_from(["a4", "letter"]),
    columns=st.integers(1, 7),
    rows=st.integers(1, 6),
    tag_size=st.floats(0.015, 0.06),
    gap=st.floats(0.126, 0.4),
    spare_across=st.floats(0.26, 2),
    spare_up=st.floats(0.26, 2),
)
@example(  # a slim bar in a rim that lies where printers do not print
    paper="letter", columns=4, rows=4, tag_size=0.040339, gap=0.218143, spare_across=0.438515, spare_up=1.27
)
def test_marks_of_any_box_keep_off_tags_cuts_each_other_and_the_papers_edge(
    *, paper: str, columns: int, rows: int, tag_size: float, gap: float, spare_across: float, spare_up: float
) -> None:
    pitch = tag_size * (1 + gap)
    width, height = (
        (n - 1) * pitch + tag_size * (1 + spare) for n, spare in ((columns, spare_across), (rows, spare_up))
    )
    box = Box(width=width, depth=width, height=height, columns=columns, rows=rows, tag_size=tag_size, pitch=pitch)
    try:
        page = page_of(box, 0, paper)
    except TargetError as error:
        assert "fit this paper" in str(error) or "leaves no room" in str(error)  # noqa: PT017 - both ways are checked
        event("refused")
        return
    event("laid out")
    marks = [slot.area for slot in (page.heading, page.notes, page.bar_across, page.bar_up)]
    module = tag_size / modules_per_side(box.dictionary)
    for i, mark in enumerate(marks):
        assert min(mark.left, mark.bottom, page.width - mark.right, page.height - mark.top) >= PRINTABLE_MARGIN - 1e-9
        assert distance(mark, page.tags) >= module - 1e-9
        assert all(distance(mark, other) >= -1e-9 for other in marks[:i])
        outside = distance(mark, page.face) >= 0.002 - 1e-9
        face = page.face
        inside = min(mark.left - face.left, face.right - mark.right, mark.bottom - face.bottom, face.top - mark.top)
        slim = mark is marks[-1] and mark.width < 0.002  # a bar in a narrow rim, so that it stays on the box
        assert outside or inside >= (0.0005 if slim else 0.002) - 1e-9
    assert (page.bar_across.turned, page.bar_up.turned) == (False, True)
    assert page.bar_across.length == pytest.approx(0.1, rel=1e-9)
    assert page.bar_up.length == pytest.approx(0.1, rel=1e-9)
    assert page.face.left >= 0.004 - 1e-9
    assert page.face.bottom >= 0.004 - 1e-9


@pytest.mark.parametrize(
    "figures",
    [
        {"width": 0.06, "depth": 0.06, "height": 0.06, "columns": 1, "rows": 1},
        {"width": 0.12, "depth": 0.12, "height": 0.12, "columns": 3, "rows": 3},
        {"width": 0.15, "depth": 0.195, "height": 0.25, "columns": 3, "rows": 6},
        {"columns": 5, "rows": 4, "tag_size": 0.04, "pitch": 0.046},
    ],
    ids=["tiny", "small", "upright", "large tags"],
)
def test_boxes_of_other_figures_can_be_printed_too(paper: str, figures: dict[str, Any]) -> None:
    pypdfium2 = pytest.importorskip("pypdfium2")
    box = Box(**figures)
    with pypdfium2.PdfDocument(sheets_pdf(make_target(box), PAPERS[paper])) as document:
        for face in range(4):
            page = page_of(box, face, paper)
            assert document[face].get_size() == pytest.approx((page.width / 0.0254 * 72, page.height / 0.0254 * 72))
            assert (page.width > page.height) == (box.face_width(face) >= box.height)


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        (
            {"height": 0.205},
            r"A4 \(297 x 210 mm\): the height of face 0 is 205 mm, 202 mm fit this paper; reduce height",
        ),
        ({"depth": 0.30}, "A4 .*: the depth of face 0 is 300 mm, 289 mm fit this paper; reduce depth"),
        ({"width": 0.30}, "A4 .*: the width of face 1 is 300 mm, 289 mm fit this paper; reduce width"),
        ({"width": 0.285, "depth": 0.285, "height": 0.202, "pitch": 0.04}, "A4: .* leaves no room for its heading"),
    ],
)
def test_a_face_that_does_not_fit_the_paper_is_refused_with_the_figure_to_change(
    figures: dict[str, Any], message: str
) -> None:
    with pytest.raises(TargetError, match=message):
        sheets_pdf(make_target(Box(**figures)), PAPERS["a4"])


def test_a_face_that_is_too_high_for_a4_can_be_printed_on_letter() -> None:
    assert sheets_pdf(make_target(Box(height=0.205)), PAPERS["letter"]).startswith(b"%PDF")


def test_each_page_says_which_face_it_is_and_how_to_print_it(pdf: Path) -> None:
    pypdfium2 = pytest.importorskip("pypdfium2")
    with pypdfium2.PdfDocument(pdf) as document:
        assert len(document) == 4
        for face in range(4):
            text = " ".join(document[face].get_textpage().get_text_bounded().split())
            for words in (
                f"Face {face}",
                f"ids {35 * face} – {35 * face + 34}",
                f"left edge meets face {(face - 1) % 4}",
                f"right edge meets face {(face + 1) % 4}",
                "Print at 100 % (actual size), no “fit to page”.",
                "both bars 100 mm, all tags 238 x 168 mm",
                "6 mm beside and 16 mm above and below the tags",
                f"target {target_sha256(make_target())[:8]}",
            ):
                assert words in text


def test_neighbouring_faces_meet_where_the_sheets_say() -> None:
    box = Box(width=0.3, depth=0.26)
    for face in range(4):
        right_edge = box.T_box_face(face) @ (box.face_width(face) / 2, 0, 0, 1)
        neighbour = (face + 1) % 4
        left_edge = box.T_box_face(neighbour) @ (-box.face_width(neighbour) / 2, 0, 0, 1)
        assert np.allclose(right_edge, left_edge, atol=1e-12)


def page_streams(pdf: bytes) -> list[bytes]:
    """Return the unpacked content of a PDF's pages (its fonts, which are streams as well, left out)."""
    packed = re.findall(rb"stream\r?\n(.*?)\s*endstream", pdf, flags=re.DOTALL)
    unpacked = [zlib.decompress(base64.a85decode(s, adobe=True)) for s in packed if s.endswith(b"~>")]
    return [content for content in unpacked if content.startswith(b"1 0 0 1 0 0 cm")]


def test_each_tag_is_one_path_filled_even_odd_in_plain_black(pdf: Path) -> None:
    streams = page_streams(pdf.read_bytes())
    assert len(streams) == 4
    for content in streams:
        operators = [line.split()[-1] for line in content.splitlines() if line.split()]
        fills = content.split(b"f*")
        assert len(fills) == 35 + 2, "35 tags and the arrow"
        assert b" re" in content, "the outline"
        assert not {b"rg", b"g", b"k", b"sc", b"scn", b"RG", b"G", b"K"} & set(operators), "a colour was set"


def test_fonts_are_embedded(pdf: Path) -> None:
    content = pdf.read_bytes()
    fonts = re.findall(rb"/BaseFont\s*/(\S+)", content)
    assert len(fonts) == 2
    assert all(b"+BitstreamVera" in font for font in fonts)
    assert content.count(b"/FontFile2") == len(fonts)


def test_both_scale_bars_stay_on_the_face_when_it_is_cut_out(paper: str) -> None:
    for face in range(4):
        page = page_of(Box(), face, paper)
        for slot in (page.bar_across, page.bar_up):
            area = slot.area
            assert min(area.left - page.face.left, area.bottom - page.face.bottom) >= 0.0005 - 1e-9
            assert min(page.face.right - area.right, page.face.top - area.top) >= 0.0005 - 1e-9
            quiet = Rect(
                left=page.tags.left - 0.0035,
                right=page.tags.right + 0.0035,
                bottom=page.tags.bottom - 0.0035,
                top=page.tags.top + 0.0035,
            )
            assert not area.overlaps(quiet)


def test_sheets_ask_viewers_not_to_scale_and_are_the_same_bytes_each_time(pdf: Path, paper: str) -> None:
    content = pdf.read_bytes()
    assert content == sheets_pdf(make_target(), PAPERS[paper])
    assert re.search(rb"/PrintScaling\s*/None", content)


def test_printables_are_what_make_target_writes_today(paper: str) -> None:
    folder = Path(__file__).resolve().parents[2] / "printables"
    stored = (folder / f"box-{paper}.pdf").read_bytes()
    # Compared unpacked: other versions of zlib pack the same pages into other bytes.
    assert page_streams(stored) == page_streams(sheets_pdf(make_target(), PAPERS[paper]))
    assert load_target(folder / "target.json").box == Box()
