"""The record card: what a box is, what it measures, and a QR code from which its target.json can be made again."""

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from boxcal.target.box import Box, Target
from boxcal.target.print.ink import BOLD, FONT, MONO, POINT, break_lines, design_id, draw_line, draw_text, fill_loops
from boxcal.target.print.page import BAR_LENGTH
from boxcal.target.print.papers import mm
from boxcal.target.tags.outline import black_outline

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

WIDE, HIGH = 0.150, 0.100
_QR_SIDE = 0.042
_MARGIN = 0.006
_TITLE_PT, _TEXT_PT, _SMALL_PT = 14.0, 9.0, 7.0
_ROW = 0.0092
_SMALL_LEADING = 1.25 * _SMALL_PT * POINT


def card_text(target: Target) -> str:
    """Return what the QR code says: the target's id, and the options of make-target that make it again."""
    options = []
    for f in fields(Box):
        value = getattr(target.box, f.name)
        shown = f"{round(value * 1000, 9):.12g}" if f.type is float or isinstance(value, float) else str(value)
        options.append(f"--{f.name.replace('_', '-')} {shown}")
    return f"boxcal target {design_id(target)}: make-target {' '.join(options)}"


def qr_modules(text: str) -> NDArray[np.bool_]:
    """Return a QR code's modules (true is white), without its quiet zone, that survives 15 % of damage."""
    from reportlab.graphics.barcode.qrencoder import QRCode, QRErrorCorrectLevel  # noqa: PLC0415 - heavy

    code: Any = QRCode(None, QRErrorCorrectLevel.M)
    code.addData(text)
    code.make()
    side = range(code.getModuleCount())
    return np.array([[not code.isDark(row, column) for column in side] for row in side])


def draw_card(canvas: "Canvas", target: Target, width: float, height: float) -> None:
    """Draw the card's page, the card centred in the upper half of a paper of width and height (m)."""
    left, top = (width - WIDE) / 2, height - 0.045
    draw_text(canvas, (left, top + 0.014), "The box's record card", size=18, font=BOLD)
    draw_text(canvas, (left, top + 0.006), "Cut it out, fill it in and stick it on the lid.", size=_TEXT_PT + 0.5)
    _draw_card(canvas, target, left, top)
    y = top - HIGH - 0.014
    draw_text(canvas, (left, y), "How to read the lengths", size=12, font=BOLD)
    for paragraph in _advice(target):
        y -= 0.0035
        for line in break_lines(paragraph, FONT, _TEXT_PT + 0.5, WIDE):
            y -= 0.0046
            draw_text(canvas, (left, y), line, size=_TEXT_PT + 0.5)
    y -= 0.012
    draw_text(canvas, (left, y), "Then", size=12, font=BOLD)
    for line in (
        "measure-target box/target.json --bar-x ... --bar-y ... --width ... --depth ...",
        "fleet-calibrate robots/*.mcap --target box/target.json",
    ):
        y -= 0.0065
        draw_text(canvas, (left, y), line, size=_TEXT_PT, font=MONO)


def _draw_card(canvas: "Canvas", target: Target, left: float, top: float) -> None:
    box = target.box
    right, bottom = left + WIDE, top - HIGH
    draw_line(canvas, (left, bottom), (right, bottom), (right, top), (left, top), close=True)
    x, y = left + _MARGIN, top - _MARGIN - 0.004
    draw_text(canvas, (x, y), f"Landmark box {design_id(target)}", size=_TITLE_PT, font=BOLD)
    for line in (
        f"{mm(box.width)} x {mm(box.depth)} x {mm(box.height)} mm (width, depth, height)",
        f"{box.columns} x {box.rows} tags of {mm(box.tag_size)} mm a face, pitch {mm(box.pitch)} mm",
        f"{box.dictionary.removeprefix('DICT_')}, ids {target.tag_ids[0]} \N{EN DASH} {target.tag_ids[-1]}",
    ):
        y -= 0.0050
        draw_text(canvas, (x, y), line, size=_TEXT_PT)
    _draw_qr(canvas, card_text(target), right - _MARGIN - _QR_SIDE, top - _MARGIN)
    note = "Scan it for the options of make-target that make this box's target.json again."
    note_top = top - _MARGIN - _QR_SIDE - 0.0035
    for k, line in enumerate(break_lines(note, FONT, _SMALL_PT, _QR_SIDE)):
        draw_text(canvas, (right - _MARGIN - _QR_SIDE, note_top - k * _SMALL_LEADING), line, size=_SMALL_PT)

    table = right - 2 * _MARGIN - _QR_SIDE
    y -= 0.0085
    draw_text(canvas, (table - 0.034, y), "designed", size=_SMALL_PT, align="right")
    draw_text(canvas, (table - 0.014, y), "measured, mm", size=_SMALL_PT, align="centre")
    for name, option, length in (
        ("bar across a sheet", "--bar-x", BAR_LENGTH),
        ("bar up a sheet", "--bar-y", BAR_LENGTH),
        ("width, face 2 to 0", "--width", box.width),
        ("depth, face 3 to 1", "--depth", box.depth),
    ):
        y -= _ROW
        draw_text(canvas, (x, y), name, size=_TEXT_PT, font=BOLD)
        draw_text(canvas, (x, y - 0.0030), option, size=_SMALL_PT - 1, font=MONO)
        draw_text(canvas, (table - 0.034, y), mm(length), size=_TEXT_PT, align="right")
        draw_line(canvas, (table - 0.028, y - 0.001), (table, y - 0.001))
    y = bottom + _MARGIN + 0.0015
    draw_text(canvas, (x, y), "with", size=_SMALL_PT)
    draw_text(canvas, (x + 0.047, y), "by", size=_SMALL_PT)
    draw_text(canvas, (x + 0.093, y), "on", size=_SMALL_PT)
    for start, end in ((0.007, 0.044), (0.052, 0.090), (0.099, WIDE - 2 * _MARGIN)):
        draw_line(canvas, (x + start, y - 0.001), (x + end, y - 0.001))


def _draw_qr(canvas: "Canvas", text: str, left: float, top: float) -> None:
    white = qr_modules(text)
    fill_loops(canvas, black_outline(white), left, top, _QR_SIDE / white.shape[0])


def _advice(target: Target) -> tuple[str, ...]:
    box = target.box
    across, up = ((n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows))
    return (
        "Bars: from the middle of one end tick to the middle of the other, on a sheet that has lain for an hour where "
        "the box will stand, for paper grows with damp. Read to 0.2 mm. A bar of 99.7 mm is a print at 99.7 %.",
        f"Better than the bars, for they are longer: all tags of a face together, {mm(across)} mm across and {mm(up)} "
        "mm up over their black edges (--tags-x, --tags-y). Readings of several faces may follow one option.",
        "Width and depth: over the glued sheets, at half height, with a caliper or between two squares. The height "
        "moves no tag, for sheets stand on the base; it may be given as a check (--height).",
    )
