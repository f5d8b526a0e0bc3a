"""Ink on a PDF page: a canvas in exact size, the tags of a face, lines and text, all in metres."""

import io
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from boxcal.target.box import Target
from boxcal.target.files.target_json import design_sha256
from boxcal.target.print.papers import mm
from boxcal.target.tags.families import modules_per_side, tag_modules
from boxcal.target.tags.outline import Loop, black_outline

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

POINT = 0.0254 / 72
"""One PDF point, m."""
HAIRLINE = 0.0001
"""Of a line to cut or fold along, m."""
FONT, BOLD, MONO = "Vera", "VeraBd", "Vera"
"""Bitstream Vera, which comes with reportlab and may be embedded: no printer puts its own font in its place."""
_SIZE = {FONT: 0.88, BOLD: 0.83}
"""Size of the letters for a nominal size in points: Vera runs so much wider, and stands taller, than Helvetica."""

_EVEN_ODD = 0
"""``FILL_EVEN_ODD`` of reportlab.pdfgen.canvas, which its type stubs do not name."""

Point = tuple[float, float]


def write_pdf(target: Target, what: str, pages: Sequence[tuple[float, float, "Callable[[Canvas], None]"]]) -> bytes:
    """Return a PDF of pages (width m, height m, draw); the same bytes for the same pages.

    It asks viewers not to scale it. Black is DeviceGray 0, so that a colour printer has no reason to mix it from
    several inks.
    """
    from reportlab.pdfgen.canvas import Canvas  # noqa: PLC0415 - a command's --help must not wait for it

    box = target.box
    buffer = io.BytesIO()
    _load_fonts()
    first: Any = FONT  # reportlab's stubs take it for a number
    canvas = Canvas(buffer, invariant=1, pageCompression=1, pdfVersion=(1, 7), lang="en", initialFontName=first)
    canvas.setTitle(f"Landmark box {mm(box.width)} x {mm(box.depth)} x {mm(box.height)} mm, {what}")
    canvas.setSubject(f"Target {design_id(target)}. Print at 100 % (actual size).")
    canvas.setAuthor("make-target")
    canvas.setViewerPreference("PrintScaling", "None")
    for width, height, draw in pages:
        canvas.setPageSize((width / POINT, height / POINT))
        draw(canvas)
        canvas.showPage()
    canvas.save()
    return buffer.getvalue()


def design_id(target: Target) -> str:
    """Return the eight digits that name a target's design on paper, whatever was measured of it."""
    return design_sha256(target)[:8]


def face_ids(target: Target, face: int) -> str:
    """Return the ids on a face as text."""
    ids = target.tag_ids[target.tag_faces == face]
    return f"ids {ids.min()} \N{EN DASH} {ids.max()}"


def draw_tags(canvas: "Canvas", target: Target, face: int, centre: Point) -> None:
    """Draw the tags of a face about its centre (m on the page): each one path filled by the even-odd rule."""
    box = target.box
    module = box.tag_size / modules_per_side(box.dictionary)
    ids = target.tag_ids[target.tag_faces == face]
    for tag_id, corners in zip(ids, box.grid_corners(), strict=True):
        left, top = corners[0] + centre
        fill_loops(canvas, _tag_outline(box.dictionary, int(tag_id)), left, top, module)


def fill_loops(canvas: "Canvas", loops: Sequence[Loop], left: float, top: float, module: float) -> None:
    """Fill closed loops of grid corners (in modules, y down from the top left) as one even-odd path."""
    path = canvas.beginPath()
    for loop in loops:
        points = [((left + x * module) / POINT, (top - y * module) / POINT) for x, y in loop]
        path.moveTo(*points[0])
        for point in points[1:]:
            path.lineTo(*point)
        path.close()
    canvas.drawPath(path, stroke=0, fill=1, fillMode=_EVEN_ODD)


@cache
def _tag_outline(dictionary: str, tag_id: int) -> tuple[Loop, ...]:
    return black_outline(tag_modules(dictionary, tag_id))


def draw_line(
    canvas: "Canvas", *points: Point, width: float = HAIRLINE, dash: Sequence[float] = (), close: bool = False
) -> None:
    """Draw a line through points (m), dashed by lengths of ink and gap (m) if any are given."""
    canvas.setLineWidth(width / POINT)
    canvas.setDash([d / POINT for d in dash])
    path = canvas.beginPath()
    path.moveTo(points[0][0] / POINT, points[0][1] / POINT)
    for x, y in points[1:]:
        path.lineTo(x / POINT, y / POINT)
    if close:
        path.close()
    canvas.drawPath(path, stroke=1, fill=0)
    canvas.setDash([])


def draw_shape(canvas: "Canvas", *points: Point, grey: float = 0.0) -> None:
    """Fill a polygon (m) with a grey (0 black, 1 white)."""
    canvas.saveState()
    canvas.setFillGray(grey)
    path = canvas.beginPath()
    path.moveTo(points[0][0] / POINT, points[0][1] / POINT)
    for x, y in points[1:]:
        path.lineTo(x / POINT, y / POINT)
    path.close()
    canvas.drawPath(path, stroke=0, fill=1)
    canvas.restoreState()


def draw_arrow(canvas: "Canvas", start: Point, end: Point, *, width: float = 0.0003, head: float = 0.0022) -> None:
    """Draw an arrow from start to end (m)."""
    (x0, y0), (x1, y1) = start, end
    length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    neck = (x1 - 0.8 * head * ux, y1 - 0.8 * head * uy)
    draw_line(canvas, start, neck, width=width)
    back = (x1 - head * ux, y1 - head * uy)
    side = (-0.32 * head * uy, 0.32 * head * ux)
    draw_shape(canvas, end, (back[0] + side[0], back[1] + side[1]), (back[0] - side[0], back[1] - side[1]))


def draw_text(
    canvas: "Canvas",
    at: Point,
    text: str,
    *,
    size: float = 8.0,
    font: str = FONT,
    align: str = "left",
    angle_deg: float = 0.0,
) -> None:
    """Write one line at a point (m) of its base line; ``size`` in points, ``align`` left, centre or right."""
    canvas.saveState()
    canvas.translate(at[0] / POINT, at[1] / POINT)
    canvas.rotate(angle_deg)
    set_font(canvas, font, size)
    shift = {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * text_width(text, font, size) / POINT
    canvas.drawString(-shift, 0, text)
    canvas.restoreState()


def text_width(text: str, font: str, size: float) -> float:
    """Return how long a line of text of a nominal size, points, is, m."""
    from reportlab.pdfbase.pdfmetrics import stringWidth  # noqa: PLC0415

    _load_fonts()
    return float(stringWidth(text, font, _SIZE[font] * size)) * POINT


def break_lines(text: str, font: str, size: float, length: float) -> list[str]:
    """Return a text broken into lines of at most a length, m."""
    from reportlab.lib.utils import simpleSplit  # noqa: PLC0415

    _load_fonts()
    return [str(line) for line in simpleSplit(text, font, _SIZE[font] * size, length / POINT)]


def set_font(canvas: "Canvas", font: str, size: float) -> None:
    """Write in a font from now on, ``size`` its nominal one in points."""
    canvas.setFont(font, _SIZE[font] * size)


@cache
def _load_fonts() -> None:
    """Make the fonts known that are embedded in what is printed."""
    from reportlab.pdfbase.pdfmetrics import registerFont  # noqa: PLC0415
    from reportlab.pdfbase.ttfonts import TTFont  # noqa: PLC0415

    for name in _SIZE:
        registerFont(TTFont(name, f"{name}.ttf"))
