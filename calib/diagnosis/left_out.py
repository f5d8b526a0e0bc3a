"""Stops of a drive that are left out: their corners are taken away, so that all stops keep their numbers."""

from collections.abc import Collection
from dataclasses import replace

from boxcal.detect.correspondences import Correspondences, StopObservation


def without_stops(drive: Correspondences, stops: Collection[int]) -> Correspondences:
    """Return a drive without the corners of some stops, numbered from 0; a stop without corners is not used."""
    kept = tuple(without_corners(stop) if j in stops else stop for j, stop in enumerate(drive.stops))
    return replace(drive, stops=kept)


def without_corners(stop: StopObservation) -> StopObservation:
    """Return a stop without corners."""
    none = slice(0, 0)
    return replace(
        stop,
        landmark_ids=stop.landmark_ids[none],
        faces=stop.faces[none],
        p_box=stop.p_box[none],
        uv_px=stop.uv_px[none],
        cov_px2=stop.cov_px2[none],
    )


def numbers(stops: Collection[int]) -> str:
    """Return the numbers of stops, from 0, as users count them, from 1."""
    return ", ".join(str(j + 1) for j in stops)


def named(stops: Collection[int], drive: Correspondences) -> str:
    """Return the stops of a drive, from 0, as messages name them: ``stops 2, 3 (of 12)``."""
    return f"stop{'s' if len(stops) > 1 else ''} {numbers(stops)} (of {len(drive.stops)})"


def said_to_be_left_out(stops: Collection[int]) -> str:
    """Return the end of a message on stops that were left out."""
    return f"{'these stops were' if len(stops) > 1 else 'this stop was'} left out"
