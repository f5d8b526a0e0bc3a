"""Dimensions of the printable solid: walls, lid, tabs, pins, numbers and inlays."""

from dataclasses import dataclass, fields
from math import isfinite

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import Box
from boxcal.target.errors import TargetError


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """Dimensions of a box's construction, m; the defaults suit 3 mm board and a 0.4 mm nozzle.

    Attributes
    ----------
    wall
        Thickness of walls, base and lid.
    lid_gap
        Between the lid and the walls around it.
    tab
        Legs of the corner tabs on which the lid rests.
    pin
        Diameter of the alignment pins: a piece of 1.75 mm filament does.
    pin_play
        By how much the pins' holes are wider.
    pin_floor
        Wall left below a pin's hole.
    engraving
        Depth of the face numbers.
    finger
        Length of a joint's fingers; the nearest that gives an odd count is used.
    layer
        Depth of the tags' inlay in panels, which are printed face down: one layer.
    line
        Depth of the tags' inlay in the whole box, which is printed upright: one line width, as a thinner upright wall
        cannot be printed.
    """

    wall: float = 0.003
    lid_gap: float = 0.0002
    tab: float = 0.015
    pin: float = 0.00175
    pin_play: float = 0.0002
    pin_floor: float = 0.001
    engraving: float = 0.0004
    finger: float = 0.020
    layer: float = 0.0002
    line: float = 0.00045


def check_build(box: Box, build: Build) -> None:
    """Check that a box can be built from these dimensions.

    Raises
    ------
    TargetError
        Naming the dimension to change.
    """
    for field in fields(Build):
        value = getattr(build, field.name)
        if not (isfinite(value) and value > 0):
            raise TargetError(f"{field.name} is {value}: a length above 0 m is needed")
    least, short = min(box.width, box.depth, box.height), min(box.width, box.depth)
    if 6 * build.wall > least:
        raise TargetError(
            f"wall is {build.wall * 1e3:g} mm: a box whose shortest side is {least * 1e3:g} mm takes at most "
            f"{least / 6 * 1e3:.3g} mm",
            remedy="reduce wall",
        )
    for name in ("pin_floor", "engraving", "layer", "line"):
        value = getattr(build, name)
        if value >= build.wall:
            raise TargetError(
                f"{name} is {value * 1e3:g} mm: less than the wall of {build.wall * 1e3:g} mm is needed",
                remedy=f"reduce {name}",
            )
    if 2 * build.tab > short - 2 * build.wall or build.tab > box.height - 2 * build.wall:
        raise TargetError(
            f"tab is {build.tab * 1e3:g} mm: corner tabs would meet inside a box of {box.width * 1e3:g} x "
            f"{box.depth * 1e3:g} x {box.height * 1e3:g} mm",
            remedy="reduce tab",
        )


def build_for(box: Box) -> Build:
    """Return the default dimensions, with wall and tabs reduced where the box is too small for them."""
    default = Build()
    wall = min(default.wall, min(box.width, box.depth, box.height) / 10)
    tab = min(default.tab, min(box.width, box.depth, box.height) / 5)
    share = wall / default.wall
    return Build(
        wall=wall,
        tab=tab,
        pin_floor=default.pin_floor * share,
        engraving=min(default.engraving, wall / 4),
        layer=min(default.layer, wall / 4),
        line=min(default.line, wall / 4),
        finger=max(default.finger, 3 * wall),
    )


def margins(box: Box, face: int) -> tuple[float, float]:
    """Return the bare rim of a face beside its tags, and above and below them, m."""
    across, up = ((n - 1) * box.pitch + box.tag_size for n in (box.columns, box.rows))
    return (box.face_width(face) - across) / 2, (box.height - up) / 2


def pin_places(box: Box, build: Build, face: int) -> Array:
    """Return where a sheet is pinned to a face, (P, 2) m, frame ``face``: near its four corners, beside the tags.

    Neighbouring faces have them at different heights, so that their holes do not meet. There are none (P = 0) where
    the tags leave no room for them.
    """
    beside, above = margins(box, face)
    hole = build.pin + build.pin_play
    if beside < hole + 0.001 or 0.4 * above < hole + 0.0005:
        return np.empty((0, 2))
    x = box.face_width(face) / 2 - beside / 2
    y = box.height / 2 - above * (0.7 if face % 2 == 0 else 0.3)
    return np.array([[-x, y], [x, y], [x, -y], [-x, -y]])
