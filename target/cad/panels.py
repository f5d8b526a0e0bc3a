"""The box as six flat panels with finger joints."""

from dataclasses import dataclass

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Box
from boxcal.target.cad.build import Build
from boxcal.target.tags.outline import black_outline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """One flat panel.

    Attributes
    ----------
    name
        ``face0`` to ``face3``, ``base`` or ``lid``.
    face
        The face that it carries; None for base and lid.
    outline : (N, 2), m
        Closed, clockwise, about the panel's middle, seen from outside.
    T_box_panel : (4, 4), m
        Its pose; the panel lies at -wall <= z <= 0.
    """

    name: str
    face: int | None
    outline: Array
    T_box_panel: Array


def panels(box: Box, build: Build) -> tuple[Panel, ...]:
    """Return the six panels; put together they fill the box's walls without overlap.

    Along an edge the fingers alternate. The ends of the upright edges belong to faces 0 and 2, as do the box's eight
    corners; the ends of the level edges belong to the faces.
    """
    found = []
    for face in range(FACES):
        outline = _outline((box.face_width(face), box.height), build, upright=face % 2 == 0, level=True)
        found.append(Panel(name=f"face{face}", face=face, outline=outline, T_box_panel=box.T_box_face(face)))
    flat = _outline((box.width, box.depth), build, upright=False, level=False)
    lid, base = np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])
    lid[2, 3] = box.height
    found.append(Panel(name="base", face=None, outline=flat, T_box_panel=base))
    found.append(Panel(name="lid", face=None, outline=flat, T_box_panel=lid))
    return tuple(found)


def widened(outline: Array, by: float) -> Array:
    """Return an outline of right angles, clockwise, moved outward by a length (half of what a laser burns away)."""
    ahead = np.sign(np.roll(outline, -1, axis=0) - outline)
    outward = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    return np.asarray(outline + by * (outward + np.roll(outward, 1, axis=0)))


def _outline(size: tuple[float, float], build: Build, *, upright: bool, level: bool) -> Array:
    """Return a panel's outline; ``upright`` and ``level``: whether the ends of those edges are its own."""
    across, down = (_breaks(length, build) for length in size)
    own = np.ones((len(down) - 1, len(across) - 1), dtype=bool)
    own[[0, -1], 1:-1] = (np.arange(len(across) - 3) % 2 == 0) == level
    own[1:-1, [0, -1]] = ((np.arange(len(down) - 3) % 2 == 0) == upright)[:, None]
    own[np.ix_([0, -1], [0, -1])] = upright and level
    (loop,) = black_outline(~own)
    return np.array([(across[x] - size[0] / 2, size[1] / 2 - down[y]) for x, y in loop])


def _breaks(length: float, build: Build) -> Array:
    """Return where along an edge the owner can change: the wall's thickness at both ends, fingers between."""
    between = length - 2 * build.wall
    count = 2 * max(1, round((between / build.finger - 1) / 2)) + 1
    return np.concatenate([[0.0], build.wall + between * np.arange(count + 1) / count, [length]])
