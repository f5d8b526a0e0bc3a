"""Printing the fold-up net: in one piece, in two halves, or in tiles, as the paper allows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

from boxcal.target.box import FACES, Box, Target
from boxcal.target.errors import TargetError
from boxcal.target.print.ink import BOLD, design_id, draw_line, draw_tags, draw_text, face_ids, text_width, write_pdf
from boxcal.target.print.marks import draw_bar, draw_notes, notes_thickness
from boxcal.target.print.net import Net, Part, make_net
from boxcal.target.print.page import (
    BAR_LENGTH,
    BAR_THICKNESS,
    CLEAR_OF_OUTLINE,
    OUTLINE_MARGIN,
    PRINTABLE_MARGIN,
    SLIM_BAR,
    printable,
    slim_rims,
)
from boxcal.target.print.papers import Paper
from boxcal.target.print.strips import OFF_JOINT, TINY, Rect, Slot, Strip, first_free
from boxcal.target.print.tiles import Drawing, draw_tile, tiles
from boxcal.target.tags.families import modules_per_side

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

BETWEEN_NETS = 0.006
_TILED_BELOW, _TILED_BESIDE = 0.018, 0.008
"""Space below and beside a net in tiles for its marks, m."""
_FOLD_DASH = (0.003, 0.002)
_CUT_WIDTH = 0.00015
_INSIDE = 0.006
"""Marks on base and lid keep this far from their edges, m."""
_LABEL_PT, _FACE_PT, _PANEL_PT = 7.0, 9.0, 14.0
_Joints = tuple[Sequence[float], Sequence[float]]
"""Where a drawing is cut into tiles: along x, and along y, m."""
_NOTES_LENGTHS = (0.200, 0.100, 0.070)


@dataclass(frozen=True, slots=True, kw_only=True)
class NetPage:
    """Nets on one page, or on one drawing that is cut into tiles.

    Attributes
    ----------
    width, height : m
        Of the page.
    nets
        Each with the place of its origin on the page, m.
    bar_across, bar_up, notes
        The scale bars and the notes on printing.
    """

    width: float
    height: float
    nets: tuple[tuple[Net, tuple[float, float]], ...]
    bar_across: Slot
    bar_up: Slot
    notes: Slot


def net_pdf(target: Target, paper: Paper) -> tuple[bytes, str]:
    """Return a PDF of the box's net for a paper, and what is in it.

    The net is printed whole if the paper holds it, else in two halves (with base and lid, or without), else in tiles
    (without).

    Raises
    ------
    TargetError
        If not even tiles can be made.
    """
    pages = net_pages(target, paper)
    if pages is not None:
        pdf = write_pdf(
            target,
            f"net on {paper.name}",
            [(p.width, p.height, partial(_draw_page, target=target, page=p)) for p in pages],
        )
        nets = [net for page in pages for net, _ in page.nets]
        whole = "in one piece" if len(nets) == 1 else f"in {len(nets)} pieces"
        panels = any(part.kind == "lid" for net in nets for part in net.parts)
        return pdf, _count(len(pages), paper) + f", the net {whole} with {'base and lid' if panels else 'flaps only'}"
    drawing = tiled_net(target, paper)
    parts = tiles(drawing, paper)
    pdf = write_pdf(
        target,
        f"net in tiles on {paper.name}",
        [(tile.width, tile.height, partial(draw_tile, drawing=drawing, tile=tile)) for tile in parts],
    )
    return pdf, _count(len(parts), paper) + ", the net with flaps only in tiles"


def net_pages(target: Target, paper: Paper) -> tuple[NetPage, ...] | None:
    """Return the pages of the largest pieces that a paper holds; None if it holds no half."""
    box, notes = target.box, notes_thickness(_notes(target))
    whole = make_net(box)
    halves = (make_net(box, (0, 1), base_on=None), make_net(box, (2, 3), base_on=2, lid_on=None))
    bare = tuple(make_net(box, faces, base_on=None, lid_on=None) for faces in ((0, 1), (2, 3)))
    options: tuple[tuple[tuple[Net, ...], ...], ...] = (
        ((whole,),),
        (halves,),
        tuple((net,) for net in halves),
        (bare,),
        tuple((net,) for net in bare),
    )
    for option in options:
        pages = [_page(box, nets, paper, notes) for nets in option]
        found = tuple(page for page in pages if page is not None)
        if len(found) == len(pages):
            return found
    return None


def tiled_net(target: Target, paper: Paper) -> Drawing:
    """Return the whole net as a drawing to cut into tiles, with its marks clear of the joints on a paper."""
    box = target.box
    net = make_net(box, base_on=None, lid_on=None)
    left, bottom, right, top = net.bounds
    module = box.tag_size / modules_per_side(box.dictionary)
    across = [
        face.centre[0] + (k - (box.columns - 2) / 2) * box.pitch for face in net.faces for k in range(box.columns - 1)
    ]
    up = [box.height / 2 + (k - (box.rows - 2) / 2) * box.pitch for k in range(box.rows - 1)]
    below = Rect(left=left, bottom=bottom - _TILED_BELOW, right=right, top=bottom - CLEAR_OF_OUTLINE)
    beside = Rect(left=left - _TILED_BESIDE, bottom=0.0, right=left - CLEAR_OF_OUTLINE, top=box.height)
    content = Rect(left=beside.left, bottom=below.bottom, right=right, top=top)
    bare = Drawing(
        name="Net",
        content=content,
        joints_across=tuple(across),
        joints_up=tuple(up),
        draw=lambda _: None,
        lines=box.pitch - box.tag_size >= 2 * module * (1 - 1e-9),
    )
    parts = tiles(bare, paper)
    lefts, tops = tuple(t.trim.left for t in parts), tuple(t.trim.top for t in parts)
    flat, upright = _rims(box, [(net, (0.0, 0.0))], content)
    marks = _marks(
        [piece for strip in (*flat, Strip(area=below, start="top")) for piece in strip.pieces(lefts)],
        [piece for strip in (*upright, Strip(area=beside, start="right")) for piece in strip.pieces(tops)],
        notes_thickness(_notes(target)),
    )
    if marks is None:
        raise TargetError(
            "tiles of this net leave no room for its scale bars", source=paper.name, remedy="print it on larger paper"
        )
    page = NetPage(width=0, height=0, nets=((net, (0.0, 0.0)),), **marks)
    return replace(bare, draw=partial(_draw_page, target=target, page=page, joints=(lefts, tops)))


def _count(pages: int, paper: Paper) -> str:
    return f"{pages} page{'s' if pages > 1 else ''} of {paper.name}"


def _page(box: Box, nets: Sequence[Net], paper: Paper, notes: Callable[[float], float]) -> NetPage | None:
    """Return nets above each other on one page with space for marks, if they fit."""
    wide = max(net.bounds[2] - net.bounds[0] for net in nets)
    high = sum(net.bounds[3] - net.bounds[1] for net in nets) + BETWEEN_NETS * (len(nets) - 1)
    for width, height in ((paper.long, paper.short), (paper.short, paper.long)):
        if wide > width - 2 * OUTLINE_MARGIN or high > height - 2 * OUTLINE_MARGIN:
            continue
        x, y = (width - wide) / 2, (height + high) / 2
        placed = []
        for net in nets:
            left, bottom, _, top = net.bounds
            placed.append((net, (x - left, y - top)))
            y -= top - bottom + BETWEEN_NETS
        inside = [Strip(area=panel, start="top") for net, at in placed for panel in _panels(net, at)]
        flat, upright = _rims(box, placed, printable(width, height))
        beside = _around(
            width, height, Rect(left=x, right=x + wide, bottom=(height - high) / 2, top=(height + high) / 2)
        )
        marks = _marks([*inside, *flat, *beside[:2]], [*inside, *upright, *beside[2:]], notes)
        if marks is not None:
            return NetPage(width=width, height=height, nets=tuple(placed), **marks)
    return None


def _rims(box: Box, placed: Sequence[tuple[Net, tuple[float, float]]], within: Rect) -> tuple[list[Strip], list[Strip]]:
    """Return the faces' rims below their tags, and those left and right of them: marks there stay when a net is cut."""
    quiet = box.tag_size / modules_per_side(box.dictionary)
    across, up = ((n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows))
    flat: list[Strip] = []
    upright: list[Strip] = []
    for net, at in placed:
        for part in net.faces:
            r, (x, y) = _bounds(part), (part.centre[0] + at[0], part.centre[1] + at[1])
            face = Rect(left=r.left + at[0], right=r.right + at[0], bottom=r.bottom + at[1], top=r.top + at[1])
            tags = Rect(left=x - across / 2, right=x + across / 2, bottom=y - up / 2, top=y + up / 2)
            low, gap = face.bottom + CLEAR_OF_OUTLINE, CLEAR_OF_OUTLINE
            area = Rect(left=face.left + gap, right=face.right - gap, bottom=low, top=tags.bottom - quiet)
            flat.append(Strip(area=area, start="bottom"))
            upright += slim_rims(face, tags, quiet, within)
    return flat, upright


def _panels(net: Net, at: tuple[float, float]) -> list[Rect]:
    """Return the free insides of base and lid on the page."""
    return [
        Rect(
            left=r.left + at[0] + _INSIDE,
            right=r.right + at[0] - _INSIDE,
            bottom=r.bottom + at[1] + _INSIDE,
            # Its name stands on top.
            top=r.top + at[1] - 3 * _INSIDE,
        )
        for part in net.parts
        if part.kind in {"base", "lid"}
        for r in (_bounds(part),)
    ]


def _around(width: float, height: float, net: Rect) -> tuple[Strip, ...]:
    """Return the free strips of a page below, above, left and right of its nets."""
    low, gap = PRINTABLE_MARGIN, CLEAR_OF_OUTLINE

    def rect(left: float, bottom: float, right: float, top: float) -> Rect:
        return Rect(left=left, bottom=bottom, right=right, top=top)

    return (
        Strip(area=rect(low, low, width - low, net.bottom - gap), start="top"),
        Strip(area=rect(low, net.top + gap, width - low, height - low), start="bottom"),
        Strip(area=rect(low, low, net.left - gap, height - low), start="right"),
        Strip(area=rect(net.right + gap, low, width - low, height - low), start="left"),
    )


def _marks(flat: Sequence[Strip], upright: Sequence[Strip], notes: Callable[[float], float]) -> dict[str, Slot] | None:
    """Return places for the scale bars and the notes, if there is room for all."""
    taken: list[Rect] = []

    def place(strips: Sequence[Strip], thickness: Callable[[float], float], lengths: Sequence[float]) -> Slot | None:
        for strip in strips:
            for length in lengths:
                slot = first_free(strip, taken, thickness(length), length) if length <= strip.length + TINY else None
                if slot is not None:
                    taken.append(slot.area)
                    return slot
        return None

    # Marks that run up are placed from the left, whichever way the others fill the same strip.
    upright = [strip if strip.turned else replace(strip, start="left") for strip in upright]
    up = None
    for strip in upright:
        thickness = BAR_THICKNESS if strip.thickness >= BAR_THICKNESS - TINY else SLIM_BAR
        up = up or place([strip], partial(_constant, thickness), (BAR_LENGTH,))
    across = place(flat, lambda _: BAR_THICKNESS, (BAR_LENGTH,))
    text = place(flat, notes, _NOTES_LENGTHS)
    if up is None or across is None or text is None:
        return None
    return {"bar_up": up, "bar_across": across, "notes": text}


def _constant(value: float, _: float) -> float:
    return value


def _draw_page(canvas: "Canvas", *, target: Target, page: NetPage, joints: _Joints = ((), ())) -> None:
    for net, at in page.nets:
        _draw_net(canvas, target, net, at, joints)
    draw_bar(canvas, page.bar_across)
    draw_bar(canvas, page.bar_up)
    draw_notes(canvas, page.notes, _notes(target))


def _draw_net(canvas: "Canvas", target: Target, net: Net, at: tuple[float, float], joints: _Joints) -> None:
    draw_line(canvas, *((x + at[0], y + at[1]) for x, y in net.cut), width=_CUT_WIDTH, close=True)
    for start, end in net.folds:
        draw_line(canvas, *((x + at[0], y + at[1]) for x, y in (start, end)), dash=_FOLD_DASH)
    for part in net.parts:
        x, y = part.centre[0] + at[0], part.centre[1] + at[1]
        if part.kind == "face":
            draw_tags(canvas, target, part.face, (x, y))
            _name_face(canvas, target, part.face, (x, at[1] + part.corners[2][1]), joints)
        else:
            _name_part(canvas, target.box, part, (x, y), joints)


def _uncut(middle: float, space: float, cuts: Sequence[float], length: float) -> float | None:
    """Return where a text of a length is centred, m, so that no joint cuts it, nearest to the middle of its area."""
    ends = [middle - space / 2, *sorted(c for c in cuts if abs(c - middle) < space / 2), middle + space / 2]
    places = []
    for low, high in pairwise(ends):
        low, high = low + OFF_JOINT + length / 2, high - OFF_JOINT - length / 2  # noqa: PLW2901 - of the text's middle
        if low <= high + TINY:
            places.append(min(max(middle, low), high))
    return min(places, key=lambda place: abs(place - middle), default=None)


def _name_face(canvas: "Canvas", target: Target, face: int, top_middle: tuple[float, float], joints: _Joints) -> None:
    """Write a face's name on its upper rim, if tags and joints leave room for it."""
    middle, top = top_middle
    box = target.box
    module = box.tag_size / modules_per_side(box.dictionary)
    rim = (box.height - (box.rows - 1) * box.pitch - box.tag_size) / 2 - module
    high = 0.0035
    if rim >= high + CLEAR_OF_OUTLINE:
        text = f"Face {face}, this way up, {face_ids(target, face)}"
        x = _uncut(middle, box.face_width(face), joints[0], text_width(text, BOLD, _FACE_PT))
        if x is not None:
            draw_text(canvas, (x, top - CLEAR_OF_OUTLINE - high), text, size=_FACE_PT, font=BOLD, align="centre")


def _name_part(canvas: "Canvas", box: Box, part: Part, at: tuple[float, float], joints: _Joints) -> None:
    """Write on base, lid and flaps what becomes of them."""
    x, y = at
    if part.kind in {"base", "lid"}:
        r = _bounds(part)
        name = "Base: stands on the floor" if part.kind == "base" else "Lid"
        high = (r.top - r.bottom) / 2
        size = _PANEL_PT * min(1.0, 0.9 * (r.right - r.left) / text_width(name, BOLD, _PANEL_PT))
        draw_text(canvas, (x, y + high - 2.2 * _INSIDE), name, size=size, font=BOLD, align="centre")
        return
    if part.kind == "seam":
        text, space = f"glue behind face {(part.face + 1) % FACES}", box.height
    else:
        where = "lid" if part.edge == "top" else "base"
        text, space = f"face {part.face}: fold back, glue inside the {where}", box.face_width(part.face)
    deep = min(_bounds(part).width, _bounds(part).height)
    angle = 90.0 if part.kind == "seam" else 0.0
    place = _uncut(y if angle else x, space - 2 * deep, joints[1 if angle else 0], text_width(text, BOLD, _LABEL_PT))
    if place is None:
        return
    half = 0.36 * _LABEL_PT * 0.0254 / 72
    spot = (x + half, place) if angle else (place, y - half)
    draw_text(canvas, spot, text, size=_LABEL_PT, align="centre", angle_deg=angle)


def _bounds(part: Part) -> Rect:
    xs, ys = zip(*part.corners, strict=True)
    return Rect(left=min(xs), right=max(xs), bottom=min(ys), top=max(ys))


def _notes(target: Target) -> str:
    return (
        "Print at 100 % (actual size), no \N{LEFT DOUBLE QUOTATION MARK}fit to page\N{RIGHT DOUBLE QUOTATION MARK}, on "
        "card or on paper that is glued on card. Both bars must measure 100 mm. Cut along solid lines; score dashed "
        f"lines and fold them backwards. {target.box.dictionary.removeprefix('DICT_')}, target {design_id(target)}"
    )
