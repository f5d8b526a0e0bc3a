"""The assembly page: six drawings from the print to the measured box."""

from math import hypot
from typing import TYPE_CHECKING

from boxcal.target.box import Target
from boxcal.target.print.ink import (
    BOLD,
    FONT,
    POINT,
    break_lines,
    design_id,
    draw_arrow,
    draw_line,
    draw_shape,
    draw_tags,
    draw_text,
)
from boxcal.target.print.page import BAR_LENGTH
from boxcal.target.print.papers import mm
from boxcal.target.print.strips import Rect
from boxcal.target.print.views import CornerView, draw_plan, plan

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

WIDE, HIGH = 0.186, 0.252
"""What the page takes up, m: it fits A4 and Letter."""
_GAP = 0.008
_TITLE_PT, _STEP_PT, _TEXT_PT = 18.0, 11.0, 8.5
_LEADING = 1.25 * _TEXT_PT * POINT
_TITLE_ROOM, _STEP_ROOM, _CAPTION_ROOM = 0.020, 0.008, 0.015
_PALE = 0.9


def draw_assembly(canvas: "Canvas", target: Target, width: float, height: float) -> None:
    """Draw the page, centred on a paper of width and height (m)."""
    box = target.box
    left, top = (width - WIDE) / 2, (height + HIGH) / 2
    draw_text(canvas, (left, top - 0.006), "Build the landmark box", size=_TITLE_PT, font=BOLD)
    first, last = target.tag_ids[0], target.tag_ids[-1]
    draw_text(
        canvas,
        (left, top - 0.0125),
        f"{mm(box.width)} x {mm(box.depth)} x {mm(box.height)} mm (width, depth, height), "
        f"{box.dictionary.removeprefix('DICT_')} ids {first} \N{EN DASH} {last}, target {design_id(target)}",
        size=_TEXT_PT + 0.5,
    )
    steps = (
        ("Print and check", _PRINT, _draw_print),
        ("Cut and glue", _GLUE, _draw_glue),
        ("Which face where", _WHERE, _draw_where),
        ("Which way up", _UP, _draw_up),
        ("Check that it is square", _SQUARE.format(mm(round(hypot(box.width, box.depth), 4))), _draw_square),
        ("Measure it", _MEASURE, _draw_measure),
    )
    wide, high = (WIDE - _GAP) / 2, (HIGH - _TITLE_ROOM - 2 * _GAP) / 3
    for i, (name, caption, draw) in enumerate(steps):
        x = left + (i % 2) * (wide + _GAP)
        y = top - _TITLE_ROOM - (i // 2) * (high + _GAP)
        draw_line(canvas, (x, y), (x + wide, y), width=0.0003)
        draw_text(canvas, (x, y - 0.0050), f"{i + 1}   {name}", size=_STEP_PT, font=BOLD)
        for k, line in enumerate(break_lines(caption, FONT, _TEXT_PT, wide)):
            draw_text(canvas, (x, y - high + _CAPTION_ROOM - 0.003 - k * _LEADING), line, size=_TEXT_PT)
        area = Rect(left=x, right=x + wide, bottom=y - high + _CAPTION_ROOM + 0.001, top=y - _STEP_ROOM)
        draw(canvas, target, area)


_PRINT = (
    "Print at 100 % (actual size), never \N{LEFT DOUBLE QUOTATION MARK}fit to page\N{RIGHT DOUBLE QUOTATION MARK}, on "
    "matt paper. Lay a ruler along both bars of a sheet: each is 100 mm long. More than 1 mm off: the page was scaled, "
    "print it again."
)
_GLUE = (
    "Cut along the outline. Glue each sheet on its side of a stiff box: the lower edge flush with the base, centred "
    "between the vertical edges. Rub from the middle outwards, so that it lies flat."
)
_WHERE = (
    "Seen from above, faces 0, 1, 2, 3 follow each other anticlockwise: each sheet names the faces that its edges meet."
)
_UP = "The arrow beside a face's name points up. Face 1 stands to the right of face 0, seen from outside."
_SQUARE = (
    "On top and at the base, both diagonals measure {} mm: let them differ by 1 mm at most. A straight edge laid on "
    "a face shows gaps: none over 0.5 mm."
)
_MEASURE = (
    "Read bar across, bar up, width and depth to 0.2 mm, over the glued sheets, and write them on the record card. "
    "measure-target puts them into target.json: every result scales with them."
)


def _sheet(target: Target, area: Rect, fraction: float = 1.0) -> tuple[Rect, float]:
    """Return face 0 within an area of a drawing, and its scale."""
    box = target.box
    scale = fraction * min(area.width / box.face_width(0), area.height / box.height)
    x, y = (area.left + area.right) / 2, (area.bottom + area.top) / 2
    half = scale * box.face_width(0) / 2, scale * box.height / 2
    return Rect(left=x - half[0], right=x + half[0], bottom=y - half[1], top=y + half[1]), scale


def _draw_face(canvas: "Canvas", target: Target, rect: Rect, scale: float) -> None:
    canvas.saveState()
    canvas.translate((rect.left + rect.right) / 2 / POINT, (rect.bottom + rect.top) / 2 / POINT)
    canvas.scale(scale, scale)
    draw_tags(canvas, target, 0, (0.0, 0.0))
    canvas.restoreState()


def _outline(canvas: "Canvas", r: Rect, width: float = 0.0002, dash: tuple[float, ...] = ()) -> None:
    draw_line(
        canvas,
        (r.left, r.bottom),
        (r.right, r.bottom),
        (r.right, r.top),
        (r.left, r.top),
        width=width,
        dash=dash,
        close=True,
    )


def _draw_print(canvas: "Canvas", target: Target, area: Rect) -> None:
    """Draw a sheet with its two bars on the left, and a ruler along one of them on the right."""
    split = area.left + 0.56 * area.width
    left = Rect(left=area.left + 0.005, right=split, bottom=area.bottom + 0.005, top=area.top - 0.001)
    face, scale = _sheet(target, left, 0.9)
    page = Rect(left=face.left - 0.002, right=face.right + 0.002, bottom=face.bottom - 0.002, top=face.top + 0.002)
    _outline(canvas, page, 0.0003)
    _outline(canvas, face, 0.0001)
    _draw_face(canvas, target, face, scale)
    middle = (face.left + face.right) / 2, (face.bottom + face.top) / 2
    box = target.box
    across, up = ((n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows))
    margins = (box.face_width(0) - across) / 2, (box.height - up) / 2
    half = min(scale * BAR_LENGTH / 2, 0.45 * (face.top - face.bottom))
    below = face.bottom + scale * margins[1] / 3
    beside = face.left + scale * margins[0] / 4
    _bar(canvas, (middle[0] - half, below), (middle[0] + half, below), tick=0.0009)
    _bar(canvas, (beside, middle[1] - half), (beside, middle[1] + half), tick=0.0004)
    x, y = split + 0.005, middle[1]
    length = area.right - 0.004 - x
    _bar(canvas, (x, y + 0.004), (x + length, y + 0.004), tick=0.0022)
    _ruler(canvas, x, y, length)
    draw_text(canvas, (x + length / 2, y + 0.0078), "100 mm", size=9, font=BOLD, align="centre")


def _bar(canvas: "Canvas", start: tuple[float, float], end: tuple[float, float], *, tick: float) -> None:
    draw_line(canvas, start, end, width=0.0005)
    dx, dy = (tick, 0.0) if start[0] == end[0] else (0.0, tick)
    for x, y in (start, end):
        draw_line(canvas, (x - dx, y - dy), (x + dx, y + dy), width=0.0005)


def _ruler(canvas: "Canvas", left: float, top: float, length: float) -> None:
    """Draw a ruler whose 0 and 100 stand under a bar's ends."""
    edge, deep = 0.004, 0.0095
    body = (
        (left - edge, top),
        (left + length + edge, top),
        (left + length + edge, top - deep),
        (left - edge, top - deep),
    )
    draw_shape(canvas, *body, grey=_PALE)
    draw_line(canvas, *body, width=0.0002, close=True)
    for k in range(21):
        x = left + length * k / 20
        draw_line(canvas, (x, top), (x, top - (0.0032 if k % 10 == 0 else 0.0022 if k % 2 == 0 else 0.0013)))
    for k in (0, 50, 100):
        draw_text(canvas, (left + length * k / 100, top - 0.0062), str(k), size=7, align="centre")
    draw_text(canvas, (left + length + edge - 0.001, top - 0.0078), "mm", size=5.5, align="right")


def _draw_glue(canvas: "Canvas", target: Target, area: Rect) -> None:
    inner = Rect(left=area.left + 0.006, right=area.right - 0.006, bottom=area.bottom + 0.006, top=area.top - 0.002)
    view = CornerView(target.box, inner)
    view.draw(canvas, None)
    at = view.place
    draw_line(canvas, at(1, -1, 0), at(1, 1, 0), width=0.0009)
    # The sheet of face 0, off its side.
    out = 0.55
    sheet = [at(1 + out, y, z) for y, z in ((-1, 0), (1, 0), (1, 1), (-1, 1))]
    draw_shape(canvas, *sheet, grey=1.0)
    view.draw_face(canvas, target, 0, out)
    draw_line(canvas, *sheet, width=0.0002, close=True)
    for y in (-1.0, 1.0):
        draw_line(canvas, at(1 + out, y, 0), at(1, y, 0), dash=(0.001, 0.001))
    draw_line(canvas, at(1 + out, -1, 0), at(1 + out, 1, 0), width=0.0009)


def _draw_where(canvas: "Canvas", target: Target, area: Rect) -> None:
    inner = Rect(left=area.left, right=area.right, bottom=area.bottom + 0.011, top=area.top - 0.011)
    rect = plan(target.box, inner)
    draw_plan(canvas, rect)
    x, y = (rect.left + rect.right) / 2, (rect.bottom + rect.top) / 2
    size, off = 10, 0.0036
    for face, (at, align) in enumerate(
        (
            ((rect.right + 0.002, y + 0.003), "left"),
            ((x + 0.003, rect.top + 0.0025), "left"),
            ((rect.left - 0.002, y - off / 3), "right"),
            ((x, rect.bottom - 0.002 - off), "centre"),
        )
    ):
        draw_text(canvas, at, f"Face {face}", size=size, font=BOLD, align=align)
    reach = 0.010
    draw_arrow(canvas, (x, y), (rect.right + reach, y))
    draw_arrow(canvas, (x, y), (x, rect.top + reach))
    draw_text(canvas, (rect.right + reach + 0.001, y - 0.001), "x", size=9)
    draw_text(canvas, (x - 0.0045, rect.top + reach - 0.002), "y", size=9)
    draw_text(canvas, (rect.left + 0.002, rect.bottom + 0.002), "lid", size=8)


def _draw_up(canvas: "Canvas", target: Target, area: Rect) -> None:
    inner = Rect(left=area.left + 0.010, right=area.right - 0.010, bottom=area.bottom + 0.006, top=area.top - 0.001)
    view = CornerView(target.box, inner)
    view.draw(canvas, target)
    for at, face in (((1, -1, 0), 0), ((-1, 1, 0), 1)):
        x, y = view.place(*at)
        sign = -1 if face == 0 else 1
        tip = view.place(at[0], at[1], 0.55)
        draw_arrow(canvas, (x + sign * 0.004, y + 0.001), (tip[0] + sign * 0.004, tip[1]), width=0.0006, head=0.0036)
        align = "right" if face == 0 else "left"
        inner_x, inner_y = view.place((1 + at[0]) / 2, (1 + at[1]) / 2, 0)
        draw_text(canvas, (inner_x + sign * 0.004, inner_y - 0.0065), f"Face {face}", size=10, font=BOLD, align=align)


def _draw_square(canvas: "Canvas", target: Target, area: Rect) -> None:
    inner = Rect(left=area.left, right=area.right, bottom=area.bottom + 0.004, top=area.top - 0.004)
    r = plan(target.box, inner)
    draw_plan(canvas, r)
    for start, end in (((r.left, r.bottom), (r.right, r.top)), ((r.left, r.top), (r.right, r.bottom))):
        middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
        draw_arrow(canvas, middle, start)
        draw_arrow(canvas, middle, end)
    length = mm(round(hypot(target.box.width, target.box.depth), 4))
    for end_y in (r.bottom, r.top):
        at = (
            r.left * 0.72 + r.right * 0.28,
            r.bottom * 0.5 + r.top * 0.5 + (end_y - r.bottom * 0.5 - r.top * 0.5) * 0.44,
        )
        text_width = 0.013
        draw_shape(
            canvas,
            (at[0] - text_width / 2, at[1] - 0.0012),
            (at[0] + text_width / 2, at[1] - 0.0012),
            (at[0] + text_width / 2, at[1] + 0.0032),
            (at[0] - text_width / 2, at[1] + 0.0032),
            grey=_PALE,
        )
        draw_text(canvas, at, length, size=9, align="centre")
    for x, sx in ((r.left, 1), (r.right, -1)):
        for y, sy in ((r.bottom, 1), (r.top, -1)):
            d = 0.0035
            draw_line(canvas, (x + sx * d, y), (x + sx * d, y + sy * d), (x, y + sy * d), width=0.0002)


def _draw_measure(canvas: "Canvas", target: Target, area: Rect) -> None:
    box = target.box
    inner = Rect(left=area.left + 0.012, right=area.right - 0.016, bottom=area.bottom + 0.008, top=area.top - 0.001)
    view = CornerView(box, inner)
    view.draw(canvas, None)
    at = view.place
    off = 0.16
    for start, end, text, side in (
        ((1 + off, -1, 0), (1 + off, 1, 0), f"depth {mm(box.depth)}", -1),
        ((1, 1 + off, 0), (-1, 1 + off, 0), f"width {mm(box.width)}", 1),
    ):
        a, b = at(*start), at(*end)
        middle = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
        draw_arrow(canvas, middle, a)
        draw_arrow(canvas, middle, b)
        align = "right" if side < 0 else "left"
        draw_text(canvas, (middle[0] + side * 0.002, middle[1] - 0.0045), text, size=9, align=align)
    for p, q in (
        ((1, -1, 0), (1 + off, -1, 0)),
        ((1, 1, 0), (1 + off, 1, 0)),
        ((1, 1, 0), (1, 1 + off, 0)),
        ((-1, 1, 0), (-1, 1 + off, 0)),
    ):
        draw_line(canvas, at(*p), at(*q))
    a, b = at(-1, 1, 0), at(-1, 1, 1)
    middle_y = (a[1] + b[1]) / 2
    for end_y in (a[1], b[1]):
        draw_arrow(canvas, (a[0] + 0.003, middle_y), (a[0] + 0.003, end_y))
    draw_text(canvas, (a[0] + 0.0045, middle_y - 0.001), f"height {mm(box.height)}", size=9)
