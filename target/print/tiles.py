"""Drawings that are larger than the paper: cut into tiles that are trimmed, laid over each other and glued."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from boxcal.target.errors import TargetError
from boxcal.target.print.ink import POINT, draw_line, draw_text
from boxcal.target.print.page import PRINTABLE_MARGIN
from boxcal.target.print.papers import Paper
from boxcal.target.print.strips import TINY, Rect

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

OVERLAP = 0.010
"""How far a tile runs on below its neighbour's, m; this is where the glue goes."""
MARK_ROOM = 0.006
"""Beside a tile, inside the printable area, for registration marks and its label, m."""
_MARK_RADIUS = 0.002
_MARK_ARM = 0.0028
_LABEL_PT = 6.5
_LABEL_UP, _LABEL_DOWN = 0.0022, 0.0040
_HAIR = 0.0005
_DASH = (0.002, 0.001)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """Something to print in exact size on one piece of paper or several.

    Attributes
    ----------
    name
        What it is, for the labels of tiles.
    content : m
        What has to be printed, in the drawing's own frame.
    joints_across, joints_up : m
        Where it may be cut: x of vertical lines, y of horizontal ones; no tag's white border lies on one.
    draw
        Draws it; its frame is the canvas's.
    lines
        Whether joints are drawn over the whole drawing; false where the gaps between tags are too narrow for a line.
    """

    name: str
    content: Rect
    joints_across: tuple[float, ...]
    joints_up: tuple[float, ...]
    draw: "Callable[[Canvas], None]"
    lines: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One tile on one page.

    Attributes
    ----------
    index, count
        Which tile of how many, from 1, row by row.
    row, column
        From the top left.
    trim : m
        The part that stays visible, in the drawing's frame.
    printed : m
        With the overlap to the right and below, where neighbours are glued on.
    width, height, shift : m
        The page, and where the drawing's origin lies on it.
    """

    index: int
    count: int
    row: int
    column: int
    trim: Rect
    printed: Rect
    width: float
    height: float
    shift: tuple[float, float]


def tile_cuts(content: tuple[float, float], joints: tuple[float, ...], space: float) -> tuple[float, ...] | None:
    """Return where to cut an axis so that the fewest tiles fit a length, as equal as may be; None if none do.

    Returns
    -------
    The ends of the content and the joints between, ascending. Every tile but the last also holds the overlap.
    """
    low, high = content
    places = [low, *sorted(j for j in set(joints) if low + TINY < j < high - TINY), high]

    def cut(limit: float) -> tuple[float, ...] | None:
        """Cut greedily with tiles of at most a limit, overlap included."""
        cuts = [0]
        while places[cuts[-1]] < high:
            start = places[cuts[-1]]
            if high - start <= limit + TINY:
                cuts.append(len(places) - 1)
                continue
            furthest = bisect_right(places, start + limit - OVERLAP + TINY) - 1
            if furthest <= cuts[-1]:
                return None
            cuts.append(furthest)
        return tuple(places[i] for i in cuts)

    best = cut(space)
    if best is None:
        return None
    limits = sorted({b - a + (OVERLAP if b < high else 0) for i, a in enumerate(places) for b in places[i + 1 :]})
    for limit in limits:
        if limit > space:
            break
        equal = cut(limit)
        if equal is not None and len(equal) == len(best):
            return equal
    return best


def tiles(drawing: Drawing, paper: Paper) -> tuple[Tile, ...]:
    """Return the tiles of a drawing on a paper, turned so that the fewest sheets are needed.

    Raises
    ------
    TargetError
        If the parts between two joints are wider than the paper.
    """
    content = drawing.content
    options = []
    for width, height in ((paper.short, paper.long), (paper.long, paper.short)):
        spare = 2 * (PRINTABLE_MARGIN + MARK_ROOM)
        xs = tile_cuts((content.left, content.right), drawing.joints_across, width - spare)
        ys = tile_cuts((-content.top, -content.bottom), tuple(-y for y in drawing.joints_up), height - spare)
        if xs is not None and ys is not None:
            options.append(_placed(drawing, xs, ys, width, height))
    if not options:
        raise TargetError(
            f"{drawing.name} cannot be cut between its tags into tiles that fit this paper",
            source=paper.name,
            remedy="reduce tag_size and pitch, or print on larger paper",
        )
    return min(options, key=len)


def _placed(
    drawing: Drawing, xs: tuple[float, ...], ys: tuple[float, ...], width: float, height: float
) -> tuple[Tile, ...]:
    content = drawing.content
    cells = [
        (row, column, Rect(left=left, right=right, bottom=bottom, top=top))
        for row, (top, bottom) in enumerate(pairwise(-y for y in ys))
        for column, (left, right) in enumerate(pairwise(xs))
    ]
    placed = []
    for index, (row, column, trim) in enumerate(cells):
        printed = replace(
            trim,
            right=trim.right + (OVERLAP if trim.right < content.right else 0),
            bottom=trim.bottom - (OVERLAP if trim.bottom > content.bottom else 0),
        )
        placed.append(
            Tile(
                index=index + 1,
                count=len(cells),
                row=row,
                column=column,
                trim=trim,
                printed=printed,
                width=width,
                height=height,
                shift=((width - printed.left - printed.right) / 2, (height - printed.bottom - printed.top) / 2),
            )
        )
    return tuple(placed)


def draw_tile(canvas: "Canvas", drawing: Drawing, tile: Tile) -> None:
    """Draw one tile: its part of the drawing, the lines to cut and to glue on, registration marks and its label."""
    p, content = tile.printed, drawing.content
    # A hair more on the outer edges, where the line to cut along lies half outside.
    left, bottom, right, top = (
        getattr(p, side) + sign * _HAIR * (abs(getattr(p, side) - getattr(content, side)) < TINY)
        for side, sign in (("left", -1), ("bottom", -1), ("right", 1), ("top", 1))
    )
    canvas.saveState()
    canvas.translate(tile.shift[0] / POINT, tile.shift[1] / POINT)
    canvas.saveState()
    window = canvas.beginPath()
    window.rect(left / POINT, bottom / POINT, (right - left) / POINT, (top - bottom) / POINT)
    canvas.clipPath(window, stroke=0, fill=0)
    drawing.draw(canvas)
    canvas.restoreState()
    _draw_joints(canvas, drawing, tile)
    middle = (p.left + p.right) / 2
    name = (
        f"{drawing.name}, tile {tile.index} of {tile.count}: row {tile.row + 1} from the top, column {tile.column + 1}"
    )
    draw_text(canvas, (middle, p.top + _LABEL_UP), name, size=_LABEL_PT, align="centre")
    draw_text(canvas, (middle, p.bottom - _LABEL_DOWN), _what_to_do(tile), size=_LABEL_PT, align="centre")
    canvas.restoreState()


def _what_to_do(tile: Tile) -> str:
    if tile.count == 1:
        return ""
    cut = " and ".join(side for side, inner in (("left", tile.column > 0), ("top", tile.row > 0)) if inner)
    if not cut:
        return "The next tiles are laid on the dashed lines."
    return f"Cut along the solid line at the {cut}; lay it on the neighbour's dashed line, so that circles close."


def _draw_joints(canvas: "Canvas", drawing: Drawing, tile: Tile) -> None:
    """Draw this tile's own cut lines solid, its neighbours' dashed, and a mark at both ends of each."""
    t, p, content = tile.trim, tile.printed, drawing.content
    beside = MARK_ROOM / 2
    for x, dash in ((t.left, ()), (t.right, _DASH)):
        if content.left + TINY < x < content.right - TINY:
            if drawing.lines:
                draw_line(canvas, (x, p.bottom), (x, p.top), dash=dash)
            for y in (p.top + beside, p.bottom - beside):
                _draw_mark(canvas, x, y)
    for y, dash in ((t.top, ()), (t.bottom, _DASH)):
        if content.bottom + TINY < y < content.top - TINY:
            if drawing.lines:
                draw_line(canvas, (p.left, y), (p.right, y), dash=dash)
            for x in (p.left - beside, p.right + beside):
                _draw_mark(canvas, x, y)


def _draw_mark(canvas: "Canvas", x: float, y: float) -> None:
    draw_line(canvas, (x - _MARK_ARM, y), (x + _MARK_ARM, y))
    draw_line(canvas, (x, y - _MARK_ARM), (x, y + _MARK_ARM))
    canvas.circle(x / POINT, y / POINT, _MARK_RADIUS / POINT, stroke=1, fill=0)
