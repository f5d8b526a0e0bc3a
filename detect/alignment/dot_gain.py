"""Growth of the tags' black, of ink that spread or a response curve that the model lacks, and what it does to corners.

Where all edges lie a little outside their modules, an alignment follows with the border, which has white on one side
only, by about half: corners err alike in all tags, and no scatter shows it. The residuals do: they sum to less than
nothing in modules, white or black, by as much as these have edges. Shifts of the tag, its light, and blur leave other
sums; what those explain is projected out, once for each pattern. What the growth then does to the corners follows from
the pattern alone: the homography that follows its displaced edges best.

Light and blur take up a part of the growth, the more the narrower modules are, in the residuals as in the corners: what
is estimated is the part that moves them, to some 20 % with all pixels and 35 % where large tags are sampled.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from boxcal.detect.alignment.pattern_edges import CORNERS, pattern_edges
from boxcal.detect.alignment.registration.begin import EDGE_SIDE_PX
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_curvature import small_homographies
from boxcal.detect.alignment.tag_patterns import Index, Patterns
from boxcal.detect.alignment.tag_shape import sides
from boxcal.target.arrays import Array

PRIOR = 0.05
"""Deviation of the growth before anything is seen, modules: prints have less, on paper that soaks it up."""
LEAST = 0.003
"""Growth, modules, of which half is believed: sums over modules know of blur only what stays in the next module."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """Effects of the edges in each of T patterns, M modules a side.

    Attributes
    ----------
    alone : (T, M * M)
        How many edges between black and white each module has, less what shifts, light and blur explain of that.
    followed : (T, 4, 2)
        Where the homography that follows a growth by one module takes the corners, modules.
    """

    alone: Array
    followed: Array


def without_dot_gain(patterns: Patterns, tags: TagAlignments, uneven: Index) -> TagAlignments:
    """Return aligned tags with corners where they would be had the black not grown.

    Parameters
    ----------
    patterns, tags
        As :func:`boxcal.detect.alignment.registration.align.align` took and returned them.
    uneven
        Rows of tags that may be unevenly lit, and so do not determine the growth.
    """
    told = tags.take(~among(tags.rows, uneven))
    if len(told) == 0:
        return tags
    followed = dot_gain(patterns, told) * edges(patterns).followed[tags.rows]
    right, down = (side / patterns.modules for side in sides(tags.corners_px))
    moved = followed[..., :1] * right[:, None] + followed[..., 1:] * down[:, None]
    return replace(tags, corners_px=tags.corners_px - moved)


def dot_gain(patterns: Patterns, tags: TagAlignments) -> float:
    """Return by how much the black of tags has grown at each edge, modules, negative where it has shrunk."""
    alone = edges(patterns).alone[tags.rows]
    right, down = (side / patterns.modules for side in sides(tags.corners_px))
    area = np.abs(right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0])
    inner = tags.blocks[:, 1:-1, 1:-1].reshape(len(tags), -1, 2)
    seen = np.sum(alone * inner[..., 0], axis=1) / tags.contrast
    # of large tags not every pixel at an edge was used
    side = 0.5 * (np.hypot(*right.T) + np.hypot(*down.T)) * patterns.modules
    square = np.sum(alone**2, axis=1)
    by_growth = -0.5 * area / np.maximum(side // EDGE_SIDE_PX, 1) * square
    variance = (tags.noise / tags.contrast) ** 2 * inner[..., 1].mean(axis=1) * square + 1e-12
    growth = np.sum(by_growth * seen / variance) / (np.sum(by_growth**2 / variance) + 1 / PRIOR**2)
    return float(growth * growth**2 / (growth**2 + LEAST**2))


@lru_cache(maxsize=4)
def edges(patterns: Patterns) -> Edges:
    """Return what the edges of patterns do."""
    lines, m, cells = pattern_edges(patterns), patterns.modules, patterns.cells
    across, down = lines.step_u.reshape(-1, m, m + 1), lines.step_v.reshape(-1, m + 1, m)
    # (rows, columns, 8): how small homographies move edges across themselves
    along_u, along_v = np.split(lines.fields, 2)
    by_u, by_v = along_u.reshape(m, m + 1, 8), along_v.reshape(m + 1, m, 8)
    lost_u, lost_v = -across[..., None] * by_u, -down[..., None] * by_v
    shifted = 0.5 * (lost_u[:, :, :-1] + lost_u[:, :, 1:] + lost_v[:, :-1] + lost_v[:, 1:])
    some_u, some_v = np.abs(across), np.abs(down)
    count = some_u[:, :, :-1] + some_u[:, :, 1:] + some_v[:, :-1] + some_v[:, 1:]
    white = cells[:, 1:-1, 1:-1]
    followed = np.einsum("tke,te->tk", lines.fitted, np.concatenate([lines.step_u, lines.step_v], axis=1))
    middles = (np.arange(m) + 0.5) / m
    x, y = np.meshgrid(middles - 0.5, middles - 0.5)
    light = np.broadcast_to(np.stack([np.ones_like(x), x, y], axis=-1), (*white.shape, 3))
    columns = [shifted, (count * (1 - 2 * white))[..., None], light, light * white[..., None]]
    basis, _ = np.linalg.qr(np.concatenate(columns, axis=3).reshape(len(cells), m * m, -1))
    flat = count.reshape(len(cells), m * m, 1)
    return Edges(
        alone=(flat - basis @ (basis.transpose(0, 2, 1) @ flat))[..., 0],
        followed=np.einsum("cik,tk->tci", small_homographies(CORNERS), followed),
    )
