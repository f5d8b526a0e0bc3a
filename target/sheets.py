"""Printable sheets: a PDF of the four faces in exact size, one face a page."""

import io
from typing import TYPE_CHECKING

from target.box import FACES, Box, Target
from target.landmarks import target_sha256
from target.marks import POINT, draw_bar, draw_heading, draw_notes, notes_thickness
from target.outline import black_outline
from target.page import Page, Paper, lay_out
from target.patterns import modules_per_side, tag_modules

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

_EVEN_ODD = 0
"""``FILL_EVEN_ODD`` of reportlab.pdfgen.canvas, which its type stubs do not name."""
_OUTLINE_WIDTH = 0.0001
"""Of the line to cut along, m."""


def sheets_pdf(target: Target, paper: Paper) -> bytes:
    """Return a PDF with one page a face, faces 0 to 3; the same bytes for the same target and paper.

    Every length is exact at a print scale of 100 %: the face is centred on the page, seen from outside with the box's
    z up the page. Each tag is one path filled by the even-odd rule. Black is DeviceGray 0, so that a colour printer
    has no reason to mix it from several inks.

    Raises
    ------
    TargetError
        If a face does not fit the paper.
    """
    from reportlab.pdfgen.canvas import Canvas  # noqa: PLC0415 - a command's --help must not wait for it

    box, digest = target.box, target_sha256(target)[:8]
    notes = [_notes(box, face, digest) for face in range(FACES)]
    pages = [lay_out(box, face, paper, notes_thickness(notes[face])) for face in range(FACES)]

    buffer = io.BytesIO()
    canvas = Canvas(buffer, invariant=1, pageCompression=1, pdfVersion=(1, 7), lang="en")
    canvas.setTitle(f"Landmark box {mm(box.width)} x {mm(box.depth)} x {mm(box.height)} mm on {paper.name}")
    canvas.setSubject(f"Target {digest}. Print at 100 % (actual size).")
    canvas.setAuthor("make-target")
    canvas.setViewerPreference("PrintScaling", "None")
    for face, page in enumerate(pages):
        canvas.setPageSize((page.width / POINT, page.height / POINT))
        _draw_tags(canvas, target, face, page)
        _draw_outline(canvas, page)
        ids = target.tag_ids[target.tag_faces == face]
        draw_heading(canvas, page.heading, face, f"ids {ids.min()} \N{EN DASH} {ids.max()}")
        draw_bar(canvas, page.bar_across)
        draw_bar(canvas, page.bar_up)
        draw_notes(canvas, page.notes, notes[face])
        canvas.showPage()
    canvas.save()
    return buffer.getvalue()


def mm(length: float) -> str:
    """Return a length in m as text in mm, to 0.01 mm and without idle zeros."""
    return f"{length * 1e3:.2f}".rstrip("0").rstrip(".")


def _notes(box: Box, face: int, digest: str) -> str:
    across, up = ((n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows))
    beside, above = (box.face_width(face) - across) / 2, (box.height - up) / 2
    return (
        "Print at 100 % (actual size), no \N{LEFT DOUBLE QUOTATION MARK}fit to page\N{RIGHT DOUBLE QUOTATION MARK}. "
        f"Then measure: both bars 100 mm, all tags together {mm(across)} x {mm(up)} mm. "
        f"Cut along the outline, {mm(beside)} mm beside and {mm(above)} mm above and below the tags. "
        f"{box.dictionary.removeprefix('DICT_')}, target {digest}"
    )


def _draw_tags(canvas: "Canvas", target: Target, face: int, page: Page) -> None:
    box = target.box
    module = box.tag_size / modules_per_side(box.dictionary)
    ids = target.tag_ids[target.tag_faces == face]
    for tag_id, corners in zip(ids, box.grid_corners(), strict=True):
        left, top = corners[0] + (page.width / 2, page.height / 2)
        path = canvas.beginPath()
        for loop in black_outline(tag_modules(box.dictionary, int(tag_id))):
            points = [((left + x * module) / POINT, (top - y * module) / POINT) for x, y in loop]
            path.moveTo(*points[0])
            for point in points[1:]:
                path.lineTo(*point)
            path.close()
        canvas.drawPath(path, stroke=0, fill=1, fillMode=_EVEN_ODD)


def _draw_outline(canvas: "Canvas", page: Page) -> None:
    face = page.face
    canvas.setLineWidth(_OUTLINE_WIDTH / POINT)
    canvas.rect(face.left / POINT, face.bottom / POINT, face.width / POINT, face.height / POINT, stroke=1, fill=0)
