"""Layout of a face's printed page: the face, its tags, and space for marks that disturb neither."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import inf

from boxcal.target.box import Box
from boxcal.target.errors import TargetError
from boxcal.target.print.papers import Paper
from boxcal.target.print.strips import TINY, Rect, Slot, Strip, first_free
from boxcal.target.tags.families import modules_per_side

PRINTABLE_MARGIN = 0.006
"""Many printers leave this much of the paper's edge white, m; every mark but the outline keeps out of it."""
COMMON_MARGIN = 0.00635
"""What most printers leave white at the paper's edges, at most, m (1/4 inch): a nearer outline is said to be so."""
OUTLINE_MARGIN = 0.004
"""A face's outline lies at least this far inside the paper, m."""
CLEAR_OF_OUTLINE = 0.002
"""Marks keep this far from the line that is cut, m."""

BAR_LENGTH = 0.100
BAR_THICKNESS = 0.003
SLIM_BAR, SLIM_CLEAR = 0.0016, 0.0005
"""Thickness of a bar in a face's narrow rim, and how far it keeps from the line that is cut, m: it stays on the box."""
HEADING_LENGTH = 0.120
"""The heading needs at least this, and spreads over the strip that it stands on, m."""
HEADING_THICKNESS = 0.004
NOTES_LENGTH = 0.060
"""Lines of the notes are at least this long, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """One face on one sheet of paper.

    Attributes
    ----------
    width, height : m
        Of the paper as it is turned.
    face, tags
        The face's outline and the block of its tags, both centred on the paper.
    heading, notes
        Which face it is; how to print, check and cut it.
    bar_across, bar_up
        The two 100 mm scale bars, centred in these.
    """

    width: float
    height: float
    face: Rect
    tags: Rect
    heading: Slot
    notes: Slot
    bar_across: Slot
    bar_up: Slot


@dataclass(frozen=True, slots=True, kw_only=True)
class Joints:
    """Lines at which a face is cut into tiles, m from its centre: to the right, and up."""

    across: tuple[float, ...]
    up: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Space:
    """Space for marks on a page that is cut at joints: places taken, and the next free one, m."""

    width: float
    height: float
    joints: Joints | None
    taken: list[Rect]

    def find(self, strips: Iterable[Strip], thickness: Callable[[float], float], length: float | None) -> Slot | None:
        """Return and take the first free place in strips for a mark of a length; None if there is none."""
        for strip in (piece for whole in strips for piece in whole.pieces(self._cuts(whole))):
            slot = first_free(strip, self.taken, thickness(strip.length), length)
            if slot is not None:
                self.taken.append(slot.area)
                return slot
        return None

    def _cuts(self, strip: Strip) -> list[float]:
        """Return where joints cut a strip, along its writing."""
        if self.joints is None:
            return []
        if strip.turned:
            return [self.height / 2 + y for y in self.joints.up]
        return [self.width / 2 + x for x in self.joints.across]


def lay_out(
    box: Box, face: int, paper: Paper, notes_thickness: Callable[[float], float], joints: Joints | None = None
) -> Page:
    """Return where everything lies on a face's page.

    Marks stand on the face's own rim where it has room, for they then stay on the box, else on the paper beside it;
    never in a tag's white border (one module), and never where many printers do not print.

    Parameters
    ----------
    box, face, paper
        What is printed on what; the paper's long side lies along the face's longer side.
    notes_thickness
        Returns the space that the notes need across their lines, m, for the length of a line, m.
    joints
        Where the page will be cut into tiles; no mark lies across one.

    Raises
    ------
    TargetError
        If the face or its marks do not fit the paper.
    """
    face_width = box.face_width(face)
    landscape = face_width >= box.height
    width, height = (paper.long, paper.short) if landscape else (paper.short, paper.long)
    _check_fit(box, face, paper, width, height)
    outline = _centred(width, height, face_width, box.height)
    grid_size = [(n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows)]
    tags = _centred(width, height, *grid_size)
    quiet = box.tag_size / modules_per_side(box.dictionary)
    rim_top, rim_bottom, rim_left, rim_right, above, below, left, right = _strips(box, width, height, outline, tags)

    space = _Space(width=width, height=height, joints=joints, taken=[])

    def place(what: str, strips: Iterable[Strip], thickness: Callable[[float], float], length: float | None) -> Slot:
        slot = space.find(strips, thickness, length)
        if slot is not None:
            return slot
        raise TargetError(
            f"face {face} of {face_width * 1e3:g} x {box.height * 1e3:g} mm leaves no room for {what} beside its tags",
            source=paper.name,
            remedy=f"reduce {_width_name(face)}, height, columns or rows, or print on other paper",
        )

    heading = place(
        "its heading",
        (rim_top, above, rim_bottom, below, left, right),
        lambda length: HEADING_THICKNESS if length >= HEADING_LENGTH - TINY else inf,
        None,
    )
    across = place("a scale bar", (rim_bottom, rim_top, below, above), lambda _: BAR_THICKNESS, BAR_LENGTH)
    up = space.find((rim_left, rim_right), lambda _: BAR_THICKNESS, BAR_LENGTH)
    up = up or space.find(slim_rims(outline, tags, quiet, printable(width, height)), lambda _: SLIM_BAR, BAR_LENGTH)
    up = up or place("a scale bar", (left, right), lambda _: BAR_THICKNESS, BAR_LENGTH)
    notes = place(
        "the printing notes",
        (rim_bottom, rim_top, below, above, right, left),
        lambda length: notes_thickness(length) if length >= NOTES_LENGTH - TINY else inf,
        None,
    )
    return Page(
        width=width,
        height=height,
        face=outline,
        tags=tags,
        heading=heading,
        notes=notes,
        bar_across=across,
        bar_up=up,
    )


def fits(box: Box, face: int, paper: Paper) -> bool:
    """Return whether a face's outline fits a paper."""
    sides = sorted((box.face_width(face), box.height))
    return all(
        side <= space - 2 * OUTLINE_MARGIN + TINY for side, space in zip(sides, (paper.short, paper.long), strict=True)
    )


def slim_rims(face: Rect, tags: Rect, quiet: float, within: Rect) -> tuple[Strip, ...]:
    """Return what is left of a face's rim left and right of its tags for a slim bar (``quiet``: a tag's border, m).

    ``within`` is where printers print.
    """
    left, right = max(face.left + SLIM_CLEAR, within.left), min(face.right - SLIM_CLEAR, within.right)
    low, high = max(face.bottom + SLIM_CLEAR, within.bottom), min(face.top - SLIM_CLEAR, within.top)
    return (
        Strip(area=Rect(left=left, right=tags.left - quiet, bottom=low, top=high), start="left"),
        Strip(area=Rect(left=tags.right + quiet, right=right, bottom=low, top=high), start="right"),
    )


def printable(width: float, height: float) -> Rect:
    """Return where most printers print on a page."""
    margin = PRINTABLE_MARGIN
    return Rect(left=margin, bottom=margin, right=width - margin, top=height - margin)


def _centred(page_width: float, page_height: float, width: float, height: float) -> Rect:
    return Rect(
        left=(page_width - width) / 2,
        right=(page_width + width) / 2,
        bottom=(page_height - height) / 2,
        top=(page_height + height) / 2,
    )


def _width_name(face: int) -> str:
    return "depth" if face % 2 == 0 else "width"


def _check_fit(box: Box, face: int, paper: Paper, width: float, height: float) -> None:
    for name, size, space in (
        (_width_name(face), box.face_width(face), width - 2 * OUTLINE_MARGIN),
        ("height", box.height, height - 2 * OUTLINE_MARGIN),
    ):
        if size > space + TINY:
            raise TargetError(
                f"{paper.name} ({width * 1e3:g} x {height * 1e3:g} mm): the {name} of face {face} is {size * 1e3:g} "
                f"mm, {space * 1e3:g} mm fit this paper",
                remedy=f"reduce {name}, print on larger paper or in tiles (--tile)",
            )


def _strips(box: Box, width: float, height: float, face: Rect, tags: Rect) -> tuple[Strip, ...]:
    """Return the free strips: the face's rim (top, bottom, left, right), then the paper above, below, left, right."""
    gap, quiet = CLEAR_OF_OUTLINE, box.tag_size / modules_per_side(box.dictionary)
    low, right_end, top_end = PRINTABLE_MARGIN, width - PRINTABLE_MARGIN, height - PRINTABLE_MARGIN
    inner = Rect(
        left=max(face.left + gap, low),
        right=min(face.right - gap, right_end),
        bottom=max(face.bottom + gap, low),
        top=min(face.top - gap, top_end),
    )

    def rect(left: float, bottom: float, right: float, top: float) -> Rect:
        return Rect(left=left, bottom=bottom, right=right, top=top)

    # Above and below the tags marks line up with them, unless the tags are too few across.
    ends = inner
    if tags.width >= HEADING_LENGTH:
        ends = replace(inner, left=max(inner.left, tags.left), right=min(inner.right, tags.right))
    span = min(max(face.width, HEADING_LENGTH), right_end - low) / 2
    start, end = width / 2 - span, width / 2 + span
    return (
        Strip(area=rect(ends.left, tags.top + quiet, ends.right, inner.top), start="top"),
        Strip(area=rect(ends.left, inner.bottom, ends.right, tags.bottom - quiet), start="bottom"),
        Strip(area=rect(inner.left, inner.bottom, tags.left - quiet, inner.top), start="left"),
        Strip(area=rect(tags.right + quiet, inner.bottom, inner.right, inner.top), start="right"),
        Strip(area=rect(start, face.top + gap, end, top_end), start="bottom"),
        Strip(area=rect(start, low, end, face.bottom - gap), start="top"),
        Strip(area=rect(low, low, face.left - gap, top_end), start="right"),
        Strip(area=rect(face.right + gap, low, right_end, top_end), start="left"),
    )
