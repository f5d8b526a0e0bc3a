"""Corners of tags in another order than described, and mirrored images, as in spoilt saved correspondences."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from boxcal.calib.diagnosis.left_out import named, said_to_be_left_out, without_corners
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.stops import MIN_STOPS
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS

AS_DESCRIBED = (0, 1, 2, 3)
"""Corners top-left, top-right, bottom-right, bottom-left."""
ORDERS = tuple(
    tuple((first + step * k) % CORNERS for k in range(CORNERS)) for step in (1, -1) for first in range(CORNERS)
)
"""The orders of the corners of a square, of which the first is as described."""
ALIKE = 0.7
"""A tag leads to another if it misses that by less than this fraction of the distance; a quarter turn misses by
1.4."""
MOST = 0.8
"""Fraction of the neighbours to which the tags must lead in an order that is taken for theirs."""
NEAR = 4.0
"""Neighbours are tags of one sheet whose middles are at most this many sides apart."""
LEAST_TAGS = 4
"""Tags of a stop from which the order of their corners is found."""

_Seen = TypeVar("_Seen", StopObservation, MovingFrame)


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerOrder:
    """Order in which the corners of an image's tags come, and its handedness.

    Attributes
    ----------
    order
        Entry c: the corner whose pixel stands where corner c's should; None where no order fits, or more than one.
    mirrored
        Whether the image shows the sheets as from behind.
    """

    order: tuple[int, ...] | None
    mirrored: bool


_RIGHT = CornerOrder(order=AS_DESCRIBED, mirrored=False)


def corner_order(ids: Ids, faces: Ids, p_box: Array, uv_px: Array) -> CornerOrder:
    """Return how the tags of an image lie, from four of which all corners were seen on.

    A tag's four corners give its axes in the image, these lead to the tags beside it, and their direction of rotation
    distinguishes the image from a mirrored one. Lens, place of the camera and how sheets are glued do not matter for
    that.

    Parameters
    ----------
    ids : (L,)
        ``4 * tag id + corner``, ascending.
    faces : (L,)
    p_box : (L, 3), m
    uv_px : (L, 2), px
    """
    first = _whole(ids)
    if len(first) < LEAST_TAGS:
        return _RIGHT
    rows = first[:, None] + np.arange(CORNERS)
    p, uv, faces = p_box[rows], uv_px[rows], faces[first]
    a, b = np.arange(len(first) - 1), np.arange(1, len(first))  # few neighbours do where all is right
    near = (faces[a] == faces[b]) & _near(p, a, b)
    if near.any() and _leads(p, uv, a[near], b[near], AS_DESCRIBED) > MOST and not _mirrored(uv):
        return _RIGHT
    a, b = np.nonzero(faces[:, None] == faces)
    near = (a != b) & _near(p, a, b)
    if not near.any():
        return _RIGHT
    fitting = [order for order in ORDERS if _leads(p, uv, a[near], b[near], order) > MOST]
    if len(fitting) != 1:
        return CornerOrder(order=None, mirrored=bool(fitting) and _mirrored(uv))
    return CornerOrder(order=fitting[0], mirrored=_mirrored(uv[:, _places(fitting[0])]))


def with_corners_in_order(drive: Correspondences) -> tuple[Correspondences, list[Finding]]:
    """Return a drive with the corners of each tag in the order in which they lie, without what is mirrored.

    Raises
    ------
    CalibError
        If too few stops are not mirrored.
    """
    orders = [corner_order(s.landmark_ids, s.faces, s.p_box, s.uv_px) for s in drive.stops]
    if all(order == _RIGHT or (order.order is None and not order.mirrored) for order in orders):
        return drive, []
    stops = tuple(_in_order(stop, order) for stop, order in zip(drive.stops, orders, strict=True))
    moving = []
    for frame in drive.moving:
        order = corner_order(frame.landmark_ids, frame.faces, frame.p_box, frame.uv_px)
        if not order.mirrored:
            moving.append(_reordered(frame, order.order or AS_DESCRIBED))
    findings = [
        *_mirrored_finding(tuple(j for j, order in enumerate(orders) if order.mirrored), drive),
        *_order_finding(
            tuple(j for j, o in enumerate(orders) if not o.mirrored and o.order not in {None, AS_DESCRIBED}), drive
        ),
    ]
    return replace(drive, stops=stops, moving=tuple(moving)), findings


def _whole(ids: Ids) -> Ids:
    """Return the rows of the first corners of tags that have all four."""
    first = np.flatnonzero(ids % CORNERS == 0)
    first = first[first + CORNERS <= len(ids)]
    return np.asarray(first[ids[first + CORNERS - 1] == ids[first] + CORNERS - 1])


def _near(p: Array, a: Ids, b: Ids) -> NDArray[np.bool_]:
    side = np.linalg.norm(p[a, 1] - p[a, 0], axis=1)
    return np.asarray(np.linalg.norm(p[b].mean(axis=1) - p[a].mean(axis=1), axis=1) < NEAR * side)


def _places(order: Sequence[int]) -> list[int]:
    """Return where each corner's pixel stands, if corner ``order[c]``'s stands where corner c's should."""
    return [list(order).index(c) for c in range(CORNERS)]


def _axes(corners: Array) -> Array:
    """Return what leads along the upper edge and down the left one (N, k, 2) of squares (N, 4, k)."""
    p0, p1, p2, p3 = np.moveaxis(corners, 1, 0)
    return np.stack([(p1 - p0 + p2 - p3) / 2, (p3 - p0 + p2 - p1) / 2], axis=2)


def _leads(p: Array, uv: Array, a: Ids, b: Ids, order: Sequence[int]) -> float:
    """Return the fraction of tags that lead to their neighbours, if their corners come in an order."""
    E, J = _axes(p), _axes(uv[:, _places(order)])
    middles, seen = p.mean(axis=1), uv.mean(axis=1)
    step = np.einsum("nij,ni->nj", E[a], middles[b] - middles[a]) / np.sum(E[a] ** 2, axis=1)
    there = seen[b] - seen[a]
    missed = np.linalg.norm(np.einsum("nij,nj->ni", J[a], step) - there, axis=1)
    return float(np.mean(missed < ALIKE * np.linalg.norm(there, axis=1)))


def _mirrored(uv: Array) -> bool:
    """Return whether most tags (N, 4, 2) are seen as from behind."""
    J = _axes(uv)
    return bool(np.mean(J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0] > 0) < 1 / 2)


def _in_order(stop: StopObservation, order: CornerOrder) -> StopObservation:
    return without_corners(stop) if order.mirrored else _reordered(stop, order.order or AS_DESCRIBED)


def _reordered(seen: _Seen, order: Sequence[int]) -> _Seen:
    """Return an image's whole tags with each pixel at the corner that it shows; tags of fewer corners are left out."""
    if tuple(order) == AS_DESCRIBED:
        return seen
    rows = (_whole(seen.landmark_ids)[:, None] + np.arange(CORNERS)).ravel()
    pixels = (_whole(seen.landmark_ids)[:, None] + _places(order)).ravel()
    return replace(
        seen,
        landmark_ids=seen.landmark_ids[rows],
        faces=seen.faces[rows],
        p_box=seen.p_box[rows],
        uv_px=seen.uv_px[pixels],
        cov_px2=seen.cov_px2[pixels],
    )


def _mirrored_finding(stops: tuple[int, ...], drive: Correspondences) -> list[Finding]:
    if not stops:
        return []
    text = (
        f"{named(stops, drive)} {'show' if len(stops) > 1 else 'shows'} the box mirrored, as if x and y of the "
        "pixels were exchanged, one of them counted backwards, or the corners of each tag the other way round"
    )
    left = sum(len(stop.landmark_ids) > 0 for stop in drive.stops) - len(stops)
    finding = Finding(
        cause="stops-mirrored",
        text=f"{text}: {said_to_be_left_out(stops)}",
        advice="Check the order of pixel coordinates and corners where they were saved, and that the picture is not "
        "flipped.",
        adopted=True,
        stops=stops,
    )
    if left < MIN_STOPS:
        raise CalibError(
            f"{text}; {left} stops are left", needed=f"at least {MIN_STOPS} are needed", remedy=finding.remedy
        )
    return [finding]


def _order_finding(stops: tuple[int, ...], drive: Correspondences) -> list[Finding]:
    if not stops:
        return []
    text = (
        f"the four corners of each tag come in another order than described at {named(stops, drive)}: "
        "they were taken for those that they are by where the tags beside them lie"
    )
    advice = "Corners are counted top-left, top-right, bottom-right, bottom-left of the tag as it is printed."
    return [Finding(cause="corner-order", text=text, advice=advice, adopted=True, stops=stops)]
