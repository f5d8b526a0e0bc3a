"""The black parts of a face's tags as polygons, where the target's corners say they are."""

from collections import Counter

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import Target
from boxcal.target.tags.families import tag_modules
from boxcal.target.tags.outline import Loop, black_outline


def tag_loops(target: Target, face: int, *, clip: float = 0.0) -> tuple[Array, ...]:
    """Return closed loops (N, 2) m, frame ``face``, that bound the black parts of its tags (even-odd).

    Parameters
    ----------
    target
        The box; a print of another scale or place shows as it is. What lies off the face's plane is put into it.
    face
        0 to 3.
    clip : m
        How much to cut from black corners that meet another one like those of a chessboard, so that no two loops touch:
        a solid in which they did would have edges with four sides.
    """
    T = target.box.T_box_face(face)
    found = []
    for row in np.flatnonzero(target.tag_faces == face):
        white = tag_modules(target.box.dictionary, int(target.tag_ids[row]))
        corners = ((target.tag_corners[row] - T[:3, 3]) @ T[:3, :3])[:, :2]
        right, down = (corners[1] - corners[0]) / white.shape[1], (corners[3] - corners[0]) / white.shape[0]
        module = float(np.linalg.norm(right))
        loops = _parted(black_outline(white), clip / module)
        found += [corners[0] + loop[:, :1] * right + loop[:, 1:] * down for loop in loops]
    return tuple(found)


def _parted(loops: tuple[Loop, ...], clip: float) -> list[Array]:
    """Return the loops (N, 2), modules, with the corners that occur twice cut off."""
    met = Counter(corner for loop in loops for corner in loop)
    found = []
    for loop in loops:
        points = np.array(loop, dtype=float)
        if clip == 0:
            found.append(points)
            continue
        before = np.sign(np.roll(points, 1, axis=0) - points)
        after = np.sign(np.roll(points, -1, axis=0) - points)
        parted: list[Array] = []
        for corner, point, back, ahead in zip(loop, points, before, after, strict=True):
            parted += [point] if met[corner] == 1 else [point + clip * back, point + clip * ahead]
        found.append(np.array(parted))
    return found
