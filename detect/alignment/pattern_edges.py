"""Edges between black and white modules of patterns, and the small homographies that follow displacements of them.

Only displacements across an edge are seen. Coordinates are those of the unit square, (0, 0) a tag's top-left corner, u
to the right, v down.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from boxcal.detect.alignment.tag_curvature import small_homographies
from boxcal.detect.alignment.tag_patterns import Patterns
from boxcal.target.arrays import Array

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
"""Of the unit square, in the order of a tag's corners."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PatternEdges:
    """Lines between neighbouring modules of T patterns, M modules a side: E = M (M + 1) across u and as many across v.

    Attributes
    ----------
    at_u, at_v : (E, 2)
        Middles of the lines that are displaced along u, row by row, and of those along v.
    step_u, step_v : (T, E)
        White less black on the way along u and v over each: 1, -1, or 0 where there is no edge.
    fields : (2 E, 8)
        Displacements across all lines, first along u, by eight small homographies.
    fitted : (T, 8, 2 E)
        Which of these, together, follow displacements across a pattern's edges best.
    """

    at_u: Array
    at_v: Array
    step_u: Array
    step_v: Array
    fields: Array
    fitted: Array


@lru_cache(maxsize=4)
def pattern_edges(patterns: Patterns) -> PatternEdges:
    """Return the edges of patterns."""
    cells, m = patterns.cells, patterns.modules
    lines, middles = np.arange(m + 1) / m, (np.arange(m) + 0.5) / m
    at_u = np.stack(np.meshgrid(lines, middles), axis=-1).reshape(-1, 2)
    at_v = np.stack(np.meshgrid(middles, lines), axis=-1).reshape(-1, 2)
    step_u = np.diff(cells[:, 1:-1], axis=2).reshape(len(cells), -1)
    step_v = np.diff(cells[:, :, 1:-1], axis=1).reshape(len(cells), -1)
    fields = np.concatenate([small_homographies(at_u)[:, 0], small_homographies(at_v)[:, 1]])
    there = np.abs(np.concatenate([step_u, step_v], axis=1))
    normal = np.einsum("te,ei,ej->tij", there, fields, fields)
    return PatternEdges(
        at_u=at_u,
        at_v=at_v,
        step_u=step_u,
        step_v=step_v,
        fields=fields,
        fitted=np.linalg.solve(normal, (there[:, :, None] * fields).transpose(0, 2, 1)),
    )
