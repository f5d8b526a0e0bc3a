"""Printable sheets: a PDF of the four faces in exact size, one face a page, or each in tiles."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from boxcal.target.box import FACES, Box, Target
from boxcal.target.errors import TargetError
from boxcal.target.print.ink import HAIRLINE, POINT, design_id, draw_tags, face_ids, write_pdf
from boxcal.target.print.marks import draw_bar, draw_heading, draw_notes, notes_thickness
from boxcal.target.print.page import COMMON_MARGIN, OUTLINE_MARGIN, Joints, Page, fits, lay_out
from boxcal.target.print.papers import Paper, mm
from boxcal.target.print.strips import Rect
from boxcal.target.print.tiles import Drawing, Tile, draw_tile, tiles
from boxcal.target.tags.families import modules_per_side

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

_BESIDE = (OUTLINE_MARGIN, 0.020, 0.040)
"""Space beside a face in tiles for the marks that its rim has no space for, m: the least that does."""


def sheets_pdf(target: Target, paper: Paper) -> bytes:
    """Return a PDF with one page a face, faces 0 to 3; the same bytes for the same target and paper.

    Every length is exact at a print scale of 100 % and as designed, whatever was measured of the box: the face is
    centred on the page, seen from outside with the box's z up the page.

    Raises
    ------
    TargetError
        If a face does not fit the paper.
    """
    pages = [_page(target, face, paper, None) for face in range(FACES)]
    return write_pdf(
        target,
        f"on {paper.name}",
        [(page.width, page.height, _drawer(target, face, page, paper)) for face, page in enumerate(pages)],
    )


def tiled_pdf(target: Target, paper: Paper) -> bytes:
    """Return a PDF of the four faces in tiles, face by face and row by row; joints run between the tags.

    Raises
    ------
    TargetError
        If a tag does not fit the paper.
    """
    pages = [
        (tile.width, tile.height, partial(draw_tile, drawing=drawing, tile=tile))
        for drawing, parts in face_tiles(target, paper)
        for tile in parts
    ]
    return write_pdf(target, f"in tiles on {paper.name}", pages)


def face_tiles(target: Target, paper: Paper) -> list[tuple[Drawing, tuple[Tile, ...]]]:
    """Return each face as a drawing about its page's origin, with its tiles on a paper."""
    return [_tiled(target, face, paper) for face in range(FACES)]


def needs_tiles(box: Box, paper: Paper) -> bool:
    """Return whether a face of a box is larger than a paper."""
    return not all(fits(box, face, paper) for face in range(FACES))


def _tiled(target: Target, face: int, paper: Paper) -> tuple[Drawing, tuple[Tile, ...]]:
    """Return a face as a drawing with its tiles; its marks lie clear of the joints that were chosen."""
    box = target.box
    module = box.tag_size / modules_per_side(box.dictionary)
    across, up = (tuple((k - (n - 2) / 2) * box.pitch for k in range(n - 1)) for n in (box.columns, box.rows))
    width, height = box.face_width(face), box.height
    for i, beside in enumerate(_BESIDE):
        sides = (width + 2 * beside, height + 2 * beside)
        # Marks may stand beside the face; then the tiles reach there, too.
        out = 0.0 if i == 0 else beside
        content = Rect(left=beside - out, right=beside + width + out, bottom=beside - out, top=beside + height + out)
        bare = Drawing(
            name=f"Face {face}",
            content=content,
            joints_across=tuple(sides[0] / 2 + x for x in across),
            joints_up=tuple(sides[1] / 2 + y for y in up),
            draw=lambda _: None,
            lines=box.pitch - box.tag_size >= 2 * module * (1 - 1e-9),
        )
        parts = tiles(bare, paper)
        cut_x = {t.trim.left - sides[0] / 2 for t in parts if t.column > 0}
        cut_y = {t.trim.top - sides[1] / 2 for t in parts if t.row > 0}
        virtual = Paper(name=f"{paper.name} in tiles", short=min(sides), long=max(sides))
        try:
            page = _page(target, face, virtual, Joints(across=tuple(sorted(cut_x)), up=tuple(sorted(cut_y))))
        except TargetError:
            if i + 1 == len(_BESIDE):
                raise
            continue
        return replace(bare, draw=_drawer(target, face, page, None)), parts
    raise AssertionError("the last width either fits or raises")


def _page(target: Target, face: int, paper: Paper, joints: Joints | None) -> Page:
    notes = _notes(target, face, paper if joints is None else None)
    return lay_out(target.box, face, paper, notes_thickness(notes), joints)


def _drawer(target: Target, face: int, page: Page, paper: Paper | None) -> "Callable[[Canvas], None]":
    def draw(canvas: "Canvas") -> None:
        draw_tags(canvas, target, face, (page.width / 2, page.height / 2))
        outline = page.face
        canvas.setLineWidth(HAIRLINE / POINT)
        canvas.rect(
            outline.left / POINT,
            outline.bottom / POINT,
            outline.width / POINT,
            outline.height / POINT,
            stroke=1,
            fill=0,
        )
        draw_heading(canvas, page.heading, face, face_ids(target, face))
        draw_bar(canvas, page.bar_across)
        draw_bar(canvas, page.bar_up)
        draw_notes(canvas, page.notes, _notes(target, face, paper))

    return draw


def _notes(target: Target, face: int, paper: Paper | None) -> str:
    box = target.box
    across, up = ((n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows))
    beside, above = (box.face_width(face) - across) / 2, (box.height - up) / 2
    sides = sorted((box.face_width(face), box.height))
    near = paper is not None and min(paper.short - sides[0], paper.long - sides[1]) / 2 < COMMON_MARGIN
    lost = ", printed or not" if near else ""
    return (
        "Print at 100 % (actual size), no \N{LEFT DOUBLE QUOTATION MARK}fit to page\N{RIGHT DOUBLE QUOTATION MARK}. "
        f"Then measure: both bars 100 mm, all tags {mm(across)} x {mm(up)} mm. "
        f"Cut along the outline{lost}, {mm(beside)} mm beside and {mm(above)} mm above and below the tags. "
        f"{box.dictionary.removeprefix('DICT_')}, target {design_id(target)}"
    )
