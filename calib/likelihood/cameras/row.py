"""Stops of all cameras of a robot in one row: where the robot stood, whichever of them saw the box there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.arrays import Ids

Numbered = tuple[StopObservation, int]
"""A stop and the number of the camera that saw it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """Stops of all cameras in one row.

    Attributes
    ----------
    drives
        Each drive with the stops of all cameras; of their landmarks only the places on the box mean anything, and its
        images are as large as the largest of any camera.
    places
        For each camera where its stops stand in the row, (P_c,); drives one behind the other.
    """

    drives: tuple[Correspondences, ...]
    places: tuple[Ids, ...]


def one_row(drives: Sequence[Sequence[Correspondences]], kept: Sequence[Sequence[Sequence[int]]]) -> Row:
    """Return the stops that the cameras of a robot use, as one row.

    Parameters
    ----------
    drives
        For each camera the same drives, as it saw them.
    kept
        For each camera and drive the numbers of the stops that it uses.

    Raises
    ------
    CalibError
        If the cameras' drives are not of the same recordings.
    """
    rows: list[Correspondences] = []
    places: list[list[int]] = [[] for _ in drives]
    before = 0
    for d, first in enumerate(drives[0]):
        views: list[Numbered] = []
        for c, (own, stops) in enumerate(zip(drives, kept, strict=True)):
            if not np.array_equal(own[d].wheels.t_ns, first.wheels.t_ns):
                raise CalibError(
                    "its cameras' correspondences hold different wheel samples",
                    source=first.robot,
                    remedy="read all cameras from the same recording",
                )
            views += [(own[d].stops[j], c) for j in stops[d]]
        together = _standing_together(sorted(views, key=lambda view: (view[0].first_sample, view[1])))
        for place, group in enumerate(together, before):
            for _, c in group:
                places[c].append(place)
        seen = tuple(_seen_by_all(group) for group in together)
        rows.append(replace(first, image_size=_largest([own[d] for own in drives]), stops=seen, moving=()))
        before += len(together)
    if any(len(set(of_camera)) < len(of_camera) for of_camera in places):
        raise CalibError(
            "its cameras' stops do not match in time", source=rows[0].robot, remedy="read all cameras with one command"
        )
    return Row(drives=tuple(rows), places=tuple(np.array(p, dtype=np.int64) for p in places))


def _largest(views: Sequence[Correspondences]) -> tuple[int, int]:
    """Return width and height, px, that hold the images of every camera."""
    return max(v.image_size[0] for v in views), max(v.image_size[1] for v in views)


def _standing_together(views: Sequence[Numbered]) -> list[list[Numbered]]:
    """Return views, ascending in time, in groups of those taken while the robot stood once."""
    groups: list[list[Numbered]] = []
    end = -1
    for view in views:
        if view[0].first_sample > end:
            groups.append([])
        groups[-1].append(view)
        end = max(end, view[0].last_sample)
    return groups


def _seen_by_all(group: Sequence[Numbered]) -> StopObservation:
    """Return the stop with all landmarks that any camera saw; pixels stand in only, for those of no camera."""
    ids = np.concatenate([stop.landmark_ids for stop, _ in group])
    unique, first = np.unique(ids, return_index=True)
    return replace(
        group[0][0],
        first_sample=min(stop.first_sample for stop, _ in group),
        last_sample=max(stop.last_sample for stop, _ in group),
        landmark_ids=unique,
        p_box=np.concatenate([stop.p_box for stop, _ in group])[first],
        faces=np.concatenate([stop.faces for stop, _ in group])[first],
        uv_px=np.concatenate([stop.uv_px for stop, _ in group])[first],
        cov_px2=np.tile(np.eye(2), (len(unique), 1, 1)),
    )
