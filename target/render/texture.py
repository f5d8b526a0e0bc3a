"""The ink on one face: black and white modules, with their exact mean over a small rectangle of the sheet."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array, Index, Reals
from boxcal.target.box import Target
from boxcal.target.tags.families import modules_per_side, tag_modules

_BINS = 2.0
"""Look-up bins to a module; breaks lie at least one module apart, so no bin holds two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Positions along one axis of a sheet at which the colour can change.

    Cell 0 lies before the first break and cell ``len(breaks) - 1`` after the last one.

    Attributes
    ----------
    breaks : (B + 1,), modules
        Ascending from 0; the last entry is infinite.
    first : (L,)
        For each half module from -0.5 on: the cell in which it begins.
    """

    breaks: Reals
    first: Index

    def locate(self, x: Reals) -> Index:
        """Return the cells that hold the positions x, modules."""
        bins = np.clip((x + np.float32(1 / _BINS)) * np.float32(_BINS), 0, len(self.first) - 1).astype(np.intp)
        cell = self.first.take(bins)
        return np.asarray(cell + (x >= self.breaks.take(cell)), dtype=np.intp)


def make_axis(count: int, modules: int, pitch: float) -> Axis:
    """Return the breaks along ``count`` tags of ``modules`` modules each, ``pitch`` modules apart."""
    breaks = (np.arange(count)[:, None] * pitch + np.arange(modules + 1)).ravel()
    starts = np.arange(-1, np.ceil(breaks[-1] * _BINS) + 1) / _BINS
    first = np.searchsorted(breaks, starts, side="right")
    return Axis(breaks=np.append(breaks, np.inf).astype(np.float32), first=first.astype(np.intp))


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceTexture:
    """The ink on one face and where it lies; outside the tags the sheet is white without end.

    Frame ``sheet``: module lengths from the top-left corner of the top-left tag, u to the right and v down.

    Attributes
    ----------
    p_box_sheet : (3, 3), m
        Maps (u, v, 1) to frame ``box``.
    along_u, along_v
        The breaks between cells.
    cells : (V, U)
        1 is ink, 0 is paper; the outermost cells are paper.
    """

    p_box_sheet: Array
    along_u: Axis
    along_v: Axis
    cells: Reals
    _counts: NDArray[np.int32]
    _shares: tuple[Reals, Reals, Reals, Reals]
    _areas: tuple[Array, Array, Array, Array]

    def uniform(self, u: Reals, v: Reals, half_u: Reals, half_v: Reals) -> tuple[NDArray[np.bool_], Reals]:
        """Return whether rectangles about (u, v) hold one colour only, and then its ink (0 or 1)."""
        i0, i1 = self.along_u.locate(u - half_u), self.along_u.locate(u + half_u)
        j0, j1 = self.along_v.locate(v - half_v), self.along_v.locate(v + half_v)
        stride = self._counts.shape[1]
        low, high = j0 * stride, (j1 + 1) * stride
        counts = self._counts.ravel()
        inked = counts.take(high + i1 + 1) - counts.take(low + i1 + 1) - counts.take(high + i0) + counts.take(low + i0)
        some = inked > 0
        return ~some | (inked == (i1 - i0 + 1) * (j1 - j0 + 1)), some.astype(np.float32)

    def mean_ink(self, u: Reals, v: Reals, width_u: Reals, width_v: Reals) -> Reals:
        """Return the mean ink over rectangles about (u, v) at most one module wide and high: exact."""
        i, a = _split(self.along_u, u, width_u)
        j, b = _split(self.along_v, v, width_v)
        j *= self.cells.shape[1]
        j += i
        both, right, below, corner = (table.take(j) for table in self._shares)
        below += a * corner
        below *= b
        right *= a
        below += right
        below += both
        return below

    def mean_ink_wide(self, u: Reals, v: Reals, width_u: Reals, width_v: Reals) -> Reals:
        """Return the mean ink over rectangles about (u, v) of any size: exact, slower than :meth:`mean_ink`."""
        wu, wv = width_u.astype(np.float64), width_v.astype(np.float64)
        left, right, above, below = u - wu / 2, u + wu / 2, v - wv / 2, v + wv / 2
        ink = self._area(right, below) - self._area(left, below) - self._area(right, above) + self._area(left, above)
        return np.asarray(ink / ((right - left) * (below - above)), dtype=np.float32)

    def _area(self, u: Array, v: Array) -> Array:
        """Return the inked area above and to the left of (u, v), square modules (a summed-area table)."""
        i, du = _within(self.along_u, u)
        j, dv = _within(self.along_v, v)
        at = j * self.cells.shape[1] + i
        whole, across, down, cell = (table.take(at) for table in self._areas)
        return np.asarray(whole + du * across + dv * down + du * dv * cell)


def face_texture(target: Target, face: int) -> FaceTexture | None:
    """Return the texture of a face, or None if it carries no tags.

    The sheet is placed by the affine map that takes the nominal grid to the tags' actual corners best (least
    squares), so a print at another scale, or a face glued askew, is followed exactly.
    """
    rows = np.flatnonzero(target.tag_faces == face)
    if len(rows) == 0:
        return None
    box = target.box
    modules = modules_per_side(box.dictionary)
    module = box.tag_size / modules
    pitch = box.pitch / module
    along_u, along_v = make_axis(box.columns, modules, pitch), make_axis(box.rows, modules, pitch)
    cells = np.zeros((len(along_v.breaks), len(along_u.breaks)), dtype=np.float32)
    grid = box.grid_corners()
    nominal = (grid - grid[0, 0]) * (1 / module, -1 / module)
    places = (target.tag_ids[rows] - box.first_id) % box.tags_a_face
    for row, place in zip(rows, places, strict=True):
        j, i = (1 + int(k) * (modules + 1) for k in divmod(int(place), box.columns))
        cells[j : j + modules, i : i + modules] = ~tag_modules(box.dictionary, int(target.tag_ids[row]))
    sheet = np.concatenate([nominal[places].reshape(-1, 2), np.ones((4 * len(rows), 1))], axis=1)
    solution = np.linalg.lstsq(sheet, target.tag_corners[rows].reshape(-1, 3), rcond=None)[0]
    return FaceTexture(
        p_box_sheet=np.asarray(solution.T),
        along_u=along_u,
        along_v=along_v,
        cells=cells,
        _counts=np.pad(cells.astype(np.int32).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))).astype(np.int32),
        _shares=_share_tables(cells),
        _areas=_area_tables(cells, along_u, along_v),
    )


def _split(axis: Axis, x: Reals, width: Reals) -> tuple[Index, Reals]:
    """Return the cell in which intervals about x begin, and the fraction of their length beyond its end."""
    begin = x - width / 2
    cell = axis.locate(begin)
    begin -= axis.breaks.take(cell)
    begin /= width
    begin += 1
    return cell, np.clip(begin, 0, 1, out=begin)


def _share_tables(cells: Reals) -> tuple[Reals, Reals, Reals, Reals]:
    """Return c0..c3 for each cell: ink = c0 + a c1 + b c2 + a b c3, (a, b) the fractions in the next column and row."""
    padded = np.pad(cells, ((0, 1), (0, 1)))
    here, right, below, corner = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    tables = (here, right - here, below - here, corner - right - below + here)
    return tables[0].ravel(), tables[1].ravel(), tables[2].ravel(), tables[3].ravel()


def _area_tables(cells: Reals, along_u: Axis, along_v: Axis) -> tuple[Array, Array, Array, Array]:
    """Return, at each cell's first corner: the inked area before it, its growth along u and along v, and the cell."""
    wide, high = (
        np.concatenate([[0.0], np.diff(axis.breaks[:-1].astype(float)), [0.0]]) for axis in (along_u, along_v)
    )
    ink = cells.astype(float)
    across, down = np.cumsum(ink * high[:, None], axis=0), np.cumsum(ink * wide, axis=1)
    before_row = np.vstack([np.zeros((1, ink.shape[1])), across[:-1]])
    before_column = np.hstack([np.zeros((ink.shape[0], 1)), down[:, :-1]])
    whole = np.cumsum(before_row * wide, axis=1)
    whole = np.hstack([np.zeros((ink.shape[0], 1)), whole[:, :-1]])
    return whole.ravel(), before_row.ravel(), before_column.ravel(), ink.ravel()


def _within(axis: Axis, x: Array) -> tuple[Index, Array]:
    """Return the cells of the positions x and how far into them they lie; beyond either end, the end's."""
    inside = np.clip(x, axis.breaks[0], axis.breaks[-2])
    cell = axis.locate(inside.astype(np.float32))
    return cell, inside - axis.breaks.take(np.maximum(cell - 1, 0))
