"""The marks of a printed page: its heading, the scale bars and the notes on printing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from boxcal.target.box import FACES
from boxcal.target.print.ink import BOLD, FONT, POINT, break_lines, set_font, text_width
from boxcal.target.print.page import BAR_LENGTH, BAR_THICKNESS, HEADING_THICKNESS
from boxcal.target.print.strips import Slot

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

_NOTES_PT, _LABEL_PT, _HEADING_PT = 6.4, 7.0, 11.0
_SLIM_PT = 4.6
"""Of the label of a slim bar."""
_NOTES_LEADING = 1.2 * _NOTES_PT * POINT
_DESCENT = 0.22
"""How far letters reach below the line, in its size."""
_LINE_WIDTH, _TICK_WIDTH = 0.0002, 0.0001


def notes_thickness(text: str) -> Callable[[float], float]:
    """Return the space, m, that a text takes across its lines as a function of their length, m."""
    return lambda length: len(break_lines(text, FONT, _NOTES_PT, length)) * _NOTES_LEADING


def draw_notes(canvas: "Canvas", slot: Slot, text: str) -> None:
    """Write the notes, broken into lines and centred."""
    lines = break_lines(text, FONT, _NOTES_PT, slot.length)
    with _along(canvas, slot):
        set_font(canvas, FONT, _NOTES_PT)
        for i, line in enumerate(reversed(lines)):
            canvas.drawCentredString(slot.length / 2 / POINT, i * _NOTES_LEADING / POINT + _DESCENT * _NOTES_PT, line)


def draw_bar(canvas: "Canvas", slot: Slot) -> None:
    """Draw a scale bar of 100 mm between the centres of its end ticks, with its length written in its middle."""
    thickness = slot.area.width if slot.turned else slot.area.height
    label, size = f"{BAR_LENGTH * 1e3:g} mm", _LABEL_PT if thickness > 0.9 * BAR_THICKNESS else _SLIM_PT
    half_gap = 0.5 * text_width(label, FONT, size) + 0.001
    start, middle = (slot.length - BAR_LENGTH) / 2, slot.length / 2
    y = thickness / 2 / POINT
    with _along(canvas, slot):
        canvas.setLineWidth(_LINE_WIDTH / POINT)
        canvas.line(start / POINT, y, (middle - half_gap) / POINT, y)
        canvas.line((middle + half_gap) / POINT, y, (start + BAR_LENGTH) / POINT, y)
        canvas.setLineWidth(_TICK_WIDTH / POINT)
        for x in (start, start + BAR_LENGTH):
            canvas.line(x / POINT, 0, x / POINT, 2 * y)
        set_font(canvas, FONT, size)
        canvas.drawCentredString(middle / POINT, y - 0.33 * size, label)


def draw_heading(canvas: "Canvas", slot: Slot, face: int, ids: str) -> None:
    """Write which face this is, which way is up, and which faces its edges meet."""
    name = f"Face {face}"
    name_width, ids_width = text_width(name, BOLD, _HEADING_PT) / POINT, text_width(ids, FONT, _LABEL_PT) / POINT
    arrow, gap = HEADING_THICKNESS / POINT, 0.003 / POINT
    up_width = text_width("up", FONT, _LABEL_PT) / POINT
    x = (slot.length / POINT - (arrow + up_width + name_width + ids_width + 2.5 * gap)) / 2
    base = 0.25 * arrow
    with _along(canvas, slot):
        _draw_up_arrow(canvas, x + arrow / 2, arrow, turned=slot.turned)
        set_font(canvas, FONT, _LABEL_PT)
        canvas.drawString(0, base, f"left edge meets face {(face - 1) % FACES}")
        canvas.drawRightString(slot.length / POINT, base, f"right edge meets face {(face + 1) % FACES}")
        x += arrow + gap / 2
        canvas.drawString(x, base, "up")
        canvas.drawString(x + up_width + name_width + 2 * gap, base, ids)
        set_font(canvas, BOLD, _HEADING_PT)
        canvas.drawString(x + up_width + gap, base, name)


def _draw_up_arrow(canvas: "Canvas", x: float, size: float, *, turned: bool) -> None:
    """Draw an arrow of a size (points) that points up the page, whichever way the writing runs."""
    canvas.saveState()
    canvas.translate(x, size / 2)
    if turned:
        canvas.rotate(-90)
    path = canvas.beginPath()
    points = ((0, 0.5), (0.3, 0.0), (0.09, 0.0), (0.09, -0.5), (-0.09, -0.5), (-0.09, 0.0), (-0.3, 0.0))
    path.moveTo(points[0][0] * size, points[0][1] * size)
    for right, up in points[1:]:
        path.lineTo(right * size, up * size)
    path.close()
    canvas.drawPath(path, stroke=0, fill=1)
    canvas.restoreState()


@contextmanager
def _along(canvas: "Canvas", slot: Slot) -> Iterator[None]:
    """Draw in a slot's own frame: x along the writing, y across it, origin where its first line would start."""
    canvas.saveState()
    if slot.turned:
        canvas.translate(slot.area.right / POINT, slot.area.bottom / POINT)
        canvas.rotate(90)
    else:
        canvas.translate(slot.area.left / POINT, slot.area.bottom / POINT)
    yield
    canvas.restoreState()
