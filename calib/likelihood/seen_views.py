"""Landmarks of several views one behind the other, and how they move as the tags' black grows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from boxcal.detect.correspondences import StopObservation
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Views:
    """Landmarks seen in P views.

    Attributes
    ----------
    landmark_ids, faces : (L,)
        Which they are, and on which face of the box.
    p_box : (L, 3), m
        Where they are on the box.
    uv_px, cov_px2 : (L, 2), (L, 2, 2), px and px^2
        Where they are seen, and with which covariance.
    starts : (P + 1,)
        First landmark of each view, and how many there are.
    """

    landmark_ids: Ids
    faces: Ids
    p_box: Array
    uv_px: Array
    cov_px2: Array
    starts: Ids

    @classmethod
    def of(cls, stops: Sequence[StopObservation]) -> Self:
        """Return what some stops saw."""
        return cls(
            landmark_ids=np.concatenate([stop.landmark_ids for stop in stops]),
            faces=np.concatenate([stop.faces for stop in stops]),
            p_box=np.concatenate([stop.p_box for stop in stops]),
            uv_px=np.concatenate([stop.uv_px for stop in stops]),
            cov_px2=np.concatenate([stop.cov_px2 for stop in stops]),
            starts=np.cumsum([0, *(len(stop.landmark_ids) for stop in stops)]),
        )


def outward_px(views: Views) -> Array:
    """Return how corners move if each edge of the tags' black moves by 1 px along its outward normal, (L, 2).

    A corner between edges of outward normals n and m moves by d with ``n d = m d = 1``. Of tags that are not seen
    whole nothing is said (zero).
    """
    ids, uv = views.landmark_ids, views.uv_px
    view = np.repeat(np.arange(len(views.starts) - 1), np.diff(views.starts))
    out = np.zeros((len(ids), 2))
    first = np.flatnonzero(ids % CORNERS == 0)
    first = first[first + CORNERS <= len(ids)]
    last = first + CORNERS - 1
    first = first[(ids[last] == ids[first] + CORNERS - 1) & (view[last] == view[first])]
    if not len(first):
        return out
    u, v = np.moveaxis(uv[first[:, None] + np.arange(CORNERS)], 2, 0)  # (T, 4) each
    before, after = np.array([3, 0, 1, 2]), np.array([1, 2, 3, 0])
    nu, nv = v[:, after] - v, u - u[:, after]  # normal to the edge from each corner to the next
    outwards = nu * (u - u.mean(axis=1, keepdims=True)) + nv * (v - v.mean(axis=1, keepdims=True))
    length = np.copysign(np.hypot(nu, nv), outwards)
    nu, nv = nu / length, nv / length
    mu, mv = nu[:, before], nv[:, before]
    determinant = nu * mv - nv * mu
    out[first[:, None] + np.arange(CORNERS)] = np.stack([(mv - nv) / determinant, (nu - mu) / determinant], axis=2)
    return out
