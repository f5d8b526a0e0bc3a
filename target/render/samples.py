"""The linear intensity of pixels and of the samples that they are split into."""

import numpy as np

from boxcal.target.arrays import Index, Reals
from boxcal.target.render.rays import Rays, rays_at
from boxcal.target.render.sides import Side

BATCH = 4096
"""Pixels of 4 x 4 samples that are worked on at once: what fits a processor's cache."""
_NEAREST = np.float32(1e-6)
"""Least depth of a homogeneous place; those behind the camera lie outside every outline anyway."""


class Forms:
    """Linear forms of the ray, (K, N), and their derivatives by the pixel; their quotients are places on a sheet."""

    def __init__(self, matrix: Reals, rays: Rays, at: Index) -> None:
        directions, (xu, xv, yu, yv) = rays_at(rays, at)
        self.value = matrix @ directions
        self.by_u = matrix[:, 0, None] * xu + matrix[:, 1, None] * yu
        self.by_v = matrix[:, 0, None] * xv + matrix[:, 1, None] * yv

    def place(self, side: Side) -> tuple[Reals, Reals, Reals, Reals]:
        """Return where pixels' centres fall on the sheet (u, v), and their half widths along u and v, modules."""
        u, v, (uu, uv), (vu, vv) = self._on_sheet(side)
        return u, v, 0.5 * (np.abs(uu) + np.abs(uv)), 0.5 * (np.abs(vu) + np.abs(vv))

    def widths(self, side: Side) -> tuple[Reals, Reals]:
        """Return the widths along u and v of the rectangle with a pixel's second moments on the sheet, modules."""
        _, _, (uu, uv), (vu, vv) = self._on_sheet(side)
        return np.hypot(uu, uv), np.hypot(vu, vv)

    def _on_sheet(self, side: Side) -> tuple[Reals, Reals, tuple[Reals, Reals], tuple[Reals, Reals]]:
        """Return places (u, v) and their derivatives by the pixel, modules."""
        w = np.maximum(self.value[2], _NEAREST)
        u, v = self.value[0] / w, self.value[1] / w
        (uu, uv), (vu, vv) = self._slope(0, u, w), self._slope(1, v, w)
        if side.bow is not None:
            u, v, u_by_u, v_by_u, v_by_v = side.bow.place(u, v)
            uu, uv, vu, vv = u_by_u * uu, u_by_u * uv, v_by_u * uu + v_by_v * vu, v_by_u * uv + v_by_v * vv
        return u, v, (uu, uv), (vu, vv)

    def _slope(self, axis: int, place: Reals, w: Reals) -> tuple[Reals, Reals]:
        """Return how fast a sheet coordinate changes along the image's u and v, modules/px."""
        by_u = (self.by_u[axis] - place * self.by_u[2]) / w
        return by_u, (self.by_v[axis] - place * self.by_v[2]) / w


class Samples:
    """The samples (N, S * S) of some pixels, on a regular grid within each, row by row."""

    def __init__(self, rays: Rays, at: Index, supersample: int) -> None:
        self.rays, self.at, self.supersample = rays, at, supersample
        steps = (np.arange(supersample) + 0.5) / supersample - 0.5
        dv, du = np.meshgrid(steps, steps, indexing="ij")
        self.offsets = np.stack([np.ones(du.size), du.ravel(), dv.ravel()]).astype(np.float32)

    def _spread(self, forms: Forms, row: int) -> Reals:
        """Return one linear form at every sample, (N, S * S)."""
        return np.stack([forms.value[row], forms.by_u[row], forms.by_v[row]], axis=1) @ self.offsets

    def intensity(self, side: Side) -> Reals:
        """Return the side's linear intensity at every sample, each the mean over its footprint.

        The footprint on the sheet is a small parallelogram; the rectangle with its second moments stands for it.
        """
        if side.texture is None or side.sheet_cam is None:
            return np.full((len(self.at), self.offsets.shape[1]), side.paper, dtype=np.float32)
        forms = Forms(side.sheet_cam, self.rays, self.at)
        w = np.maximum(self._spread(forms, 2), _NEAREST)
        u: Reals = self._spread(forms, 0) / w
        v: Reals = self._spread(forms, 1) / w
        if side.bow is not None:
            u, v, *_ = side.bow.place(u, v)
        width_u, width_v = (width[:, None] / np.float32(self.supersample) for width in forms.widths(side))
        wide = (np.maximum(width_u, width_v) > 1).ravel()
        if not wide.any():
            ink = side.texture.mean_ink(u, v, width_u, width_v)
        else:
            ink = np.empty_like(u)
            ink[~wide] = side.texture.mean_ink(u[~wide], v[~wide], width_u[~wide], width_v[~wide])
            ink[wide] = side.texture.mean_ink_wide(u[wide], v[wide], width_u[wide], width_v[wide])
        return np.asarray(side.paper + ink * (side.ink - side.paper), dtype=np.float32)

    def coverage(self, edges: Reals) -> Reals:
        """Return the fraction of every sample that lies within the outline.

        A sample's fraction on one side of an edge follows from its distance to the edge; between two opposite edges
        the fractions overlap, so that two sides that meet in an edge share it without gap or excess.
        """
        fractions = []
        for pair in (edges[0::2], edges[1::2]):
            both = np.float32(-1)
            for edge in pair:
                forms = Forms(edge[None, :], self.rays, self.at)
                slope = np.maximum(np.hypot(forms.by_u[0], forms.by_v[0]), np.float32(1e-12))
                distance = self._spread(forms, 0) * (np.float32(self.supersample) / slope)[:, None]
                both = both + np.clip(distance + np.float32(0.5), 0, 1)
            fractions.append(np.maximum(both, 0))
        return np.asarray(fractions[0] * fractions[1], dtype=np.float32)


def batches(at: Index, supersample: int) -> list[Index]:
    """Return pixels in parts whose samples fit a cache."""
    size = max(1, BATCH * 16 // supersample**2)
    return [at[first : first + size] for first in range(0, len(at), size)]


def uniform_ink(side: Side, rays: Rays, at: Index) -> tuple[Reals, Index]:
    """Return the linear intensity (N,) of pixels that show one colour of a side, and the rows of those that do not."""
    intensity = np.full(len(at), side.paper, dtype=np.float32)
    mixed = []
    if side.texture is None or side.sheet_cam is None:
        return intensity, np.zeros(0, dtype=np.intp)
    for first in range(0, len(at), 8 * BATCH):
        part = at[first : first + 8 * BATCH]
        uniform, ink = side.texture.uniform(*Forms(side.sheet_cam, rays, part).place(side))
        intensity[first : first + 8 * BATCH] += ink * (side.ink - side.paper)
        mixed.append(first + np.flatnonzero(~uniform))
    return intensity, np.concatenate([np.zeros(0, dtype=np.intp), *mixed])
