"""Stops whose corners no view of the box gives, as with landmarks in another order, and the drive without them."""

from collections.abc import Sequence

import cv2
import numpy as np

from boxcal.calib.diagnosis.left_out import named, numbers, said_to_be_left_out, without_stops
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.stops import MIN_STOPS
from boxcal.target.arrays import Array
from boxcal.target.box import CORNERS

ALIKE = 0.3
"""Corners that miss an affine view of the box by less than this fraction of their own spread need no closer look."""
NEAR = 0.1
"""A corner belongs to a plane's view if it misses that by less than this fraction of their spread: a lens bends
less."""
MOST = 0.5
"""Fraction of a stop's corners that must belong to the views of their sheets."""
LEAST = 2 * CORNERS
"""Corners of a sheet that determine its view."""


def scrambled_stops(stops: Sequence[StopObservation]) -> tuple[int, ...]:
    """Return the stops, from 0, most of whose corners do not lie as those of a sheet seen by any camera.

    A sheet in an image follows a homography, but for the lens; where sheets are glued or how tags are numbered from
    sheet to sheet makes no difference to that.
    """
    return tuple(j for j, stop in enumerate(stops) if _scrambled(stop))


def without_scrambled(drive: Correspondences) -> tuple[Correspondences, Finding | None]:
    """Return a drive without the corners of stops that show no view of the box, and what is said of them, if any are.

    The stops stay, so that all stops keep their numbers; a stop without corners is not used.

    Raises
    ------
    CalibError
        If too few others are left.
    """
    odd = scrambled_stops(drive.stops)
    if not odd:
        return drive, None
    seen = sum(len(stop.landmark_ids) > 0 for stop in drive.stops)
    text = (
        f"the corners of {named(odd, drive)} do not lie as those of flat sheets do in any picture, as if pixels were "
        "assigned to other landmarks"
    )
    left = seen - len(odd)
    if left < max(MIN_STOPS, len(odd)):
        others = numbers([j for j, stop in enumerate(drive.stops) if len(stop.landmark_ids) and j not in odd])
        raise CalibError(
            f"{text}; {left} stops are left{f' ({others})' if left else ''}",
            needed=f"at least {MIN_STOPS} are needed, and more than are in disorder",
            remedy="check the order of landmarks and pixels where they were saved, and the box's target.json",
        )
    finding = Finding(
        cause="stops-scrambled",
        text=f"{text}: {said_to_be_left_out(odd)}",
        advice="Check the order of landmarks and pixels of such stops where they were saved.",
        adopted=True,
        stops=odd,
    )
    return without_stops(drive, odd), finding


def _scrambled(stop: StopObservation) -> bool:
    if len(stop.landmark_ids) < LEAST or affine_misfit(stop) < ALIKE:
        return False
    missed = missed_views(stop)
    looked_at = np.isfinite(missed)
    return int(looked_at.sum()) >= LEAST and np.sum(missed <= NEAR) < MOST * looked_at.sum()


def affine_misfit(stop: StopObservation) -> float:
    """Return how far corners miss the nearest affine view of the box, root mean square, over their spread."""
    p, uv = stop.p_box - stop.p_box.mean(axis=0), stop.uv_px - stop.uv_px.mean(axis=0)
    A = np.linalg.lstsq(p, uv, rcond=1e-6)[0]
    return float(np.linalg.norm(uv - p @ A) / np.linalg.norm(uv))


def missed_views(stop: StopObservation) -> Array:
    """Return how far corners (L,) lie from the view of their sheet's plane on which most of it agrees, over its spread.

    Infinite where no view is found, NaN on sheets of too few corners for one.
    """
    missed = np.full(len(stop.landmark_ids), np.nan)
    for face in np.unique(stop.faces):
        on = stop.faces == face
        if on.sum() >= LEAST:
            missed[on] = _missed_view(stop.p_box[on], stop.uv_px[on])
    return missed


def _missed_view(p: Array, uv: Array) -> Array:
    p = p - p.mean(axis=0)
    in_plane = p @ np.linalg.svd(p, full_matrices=False)[2][:2].T
    spread = float(np.sqrt(np.mean(np.sum((uv - uv.mean(axis=0)) ** 2, axis=1))))
    H, _ = cv2.findHomography(in_plane, uv, cv2.RANSAC, NEAR * spread)
    if np.ndim(H) != 2:  # None where no view is found
        return np.full(len(p), np.inf)
    seen = np.column_stack([in_plane, np.ones(len(p))]) @ H.T
    seen[seen[:, 2] == 0, 2] = np.finfo(float).tiny  # on the horizon: as far as can be
    return np.asarray(np.linalg.norm(seen[:, :2] / seen[:, 2:] - uv, axis=1) / spread)
