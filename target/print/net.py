"""The fold-up net: faces side by side as they meet on the box, with fold lines, glue flaps, base and lid."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from boxcal.target.box import FACES, Box
from boxcal.target.errors import TargetError

FLAP = 0.015
"""Depth of a glue flap, m (less on a small box)."""

Point = tuple[float, float]
PartKind = Literal["face", "flap", "seam", "base", "lid"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One flat part of a net.

    Attributes
    ----------
    kind
        A face, a glue flap at its top or bottom, the ``seam`` flap that closes the ring of faces, the base or the lid.
    face
        The face that it is, or hangs on.
    edge
        Which edge of that face it hangs on; empty for a face.
    corners : m
        In the net's frame, anticlockwise.
    """

    kind: PartKind
    face: int
    edge: Literal["", "top", "bottom", "right"]
    corners: tuple[Point, ...]

    @property
    def centre(self) -> Point:
        """Middle of its bounding box, m."""
        xs, ys = zip(*self.corners, strict=True)
        return (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Net:
    """One piece of card that folds up to some or all faces of a box.

    Frame ``net``: its outside seen from the front, x right and y up along the faces; the origin is the bottom left
    corner of its first face. Every fold is a mountain: backwards by a right angle.

    Attributes
    ----------
    parts
        Faces from left to right, each followed by what hangs on it.
    cut : m
        The outline to cut along, a closed polygon, anticlockwise.
    folds : m
        Pairs of points.
    """

    parts: tuple[Part, ...]
    cut: tuple[Point, ...]
    folds: tuple[tuple[Point, Point], ...]

    @property
    def faces(self) -> tuple[Part, ...]:
        """The faces, from left to right."""
        return tuple(part for part in self.parts if part.kind == "face")

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top of the outline, m."""
        xs, ys = zip(*self.cut, strict=True)
        return min(xs), min(ys), max(xs), max(ys)


def make_net(
    box: Box, faces: tuple[int, ...] = (0, 1, 2, 3), *, base_on: int | None = 1, lid_on: int | None = 1
) -> Net:
    """Return the net of neighbouring faces, left to right.

    Parameters
    ----------
    box, faces
        Each face must be followed by its neighbour to the right.
    base_on, lid_on
        The face that the base or the lid hangs on; None leaves it out.
    """
    if any((a + 1) % FACES != b for a, b in pairwise(faces)) or not faces:
        raise TargetError(f"faces {faces}: a net needs neighbours from left to right, such as (0, 1, 2, 3)")
    flap = min(FLAP, box.height / 3, box.width / 3, box.depth / 3)
    lefts = np.concatenate([[0.0], np.cumsum([box.face_width(f) for f in faces])])
    parts: list[Part] = []
    bottom: list[Point] = []
    top: list[Point] = []
    for i, face in enumerate(faces):
        left, right, high = float(lefts[i]), float(lefts[i + 1]), box.height
        parts.append(
            Part(kind="face", face=face, edge="", corners=((left, 0), (right, 0), (right, high), (left, high)))
        )
        across = box.face_width(face + 1)
        below = _hanging(left, right, across if face == base_on else flap, taper=face != base_on)
        above = _hanging(left, right, across if face == lid_on else flap, taper=face != lid_on)
        bottom += [(x, -y) for x, y in below]
        top += [(x, high + y) for x, y in above]
        parts.append(_part("base" if face == base_on else "flap", face, "bottom", [(x, -y) for x, y in below]))
        parts.append(
            _part("lid" if face == lid_on else "flap", face, "top", [(x, high + y) for x, y in reversed(above)])
        )
    end, high = float(lefts[-1]), box.height
    seam = [(end, 0.0), (end + flap, flap), (end + flap, high - flap), (end, high)]
    parts.append(_part("seam", faces[-1], "right", seam))
    folds = [((float(x), 0.0), (float(x), high)) for x in lefts[1:]]
    folds += [((float(a), y), (float(b), y)) for y in (0.0, high) for a, b in pairwise(lefts)]
    return Net(parts=tuple(parts), cut=_clean([*bottom, *seam, *reversed(top)]), folds=tuple(folds))


def _hanging(left: float, right: float, depth: float, *, taper: bool) -> list[Point]:
    """Return what hangs on an edge from left to right, (x, distance from the edge)."""
    slope = depth if taper else 0.0
    return [(left, 0.0), (left + slope, depth), (right - slope, depth), (right, 0.0)]


def _part(kind: PartKind, face: int, edge: Literal["top", "bottom", "right"], corners: list[Point]) -> Part:
    return Part(kind=kind, face=face, edge=edge, corners=tuple(corners))


def _clean(corners: list[Point]) -> tuple[Point, ...]:
    """Return a closed polygon without repeated points."""
    kept: list[Point] = []
    for corner in corners:
        if not kept or max(abs(corner[0] - kept[-1][0]), abs(corner[1] - kept[-1][1])) > 1e-12:
            kept.append(corner)
    return tuple(kept)
