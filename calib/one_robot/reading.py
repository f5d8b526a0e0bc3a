"""Drives of one robot, read from recordings or correspondences, with the landmarks where the box has them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.one_robot.views_by_wheels import views_by_wheels
from boxcal.calib.settings import CORRESPONDENCES, Job, Nominal, Settings
from boxcal.detect.correspondences import Correspondences, StopObservation, load_correspondences, taken_as
from boxcal.detect.extract import ExtractSettings, Pictures, extract
from boxcal.detect.log.wheel_samples import WheelUnits
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256

Seen = TypeVar("Seen", StopObservation, MovingFrame)
_SAME_PLACE = 1e-6
"""How far a landmark may lie from where a box has it, m: rounding only."""


def read(
    log: Path, job: Job, progress: Callable[[str, float], None] | None = None, pictures: Pictures | None = None
) -> Correspondences:
    """Return what a robot saw and did in one drive; ``pictures`` is given a frame of each stop of a recording."""
    if log.suffix == CORRESPONDENCES:
        try:
            drive, units = load_correspondences(log), job.settings.wheel_units
            if units != WheelUnits():  # without a word on units the readings stay what they were taken for
                drive = taken_as(drive, units)
            return placed(drive, job.target)
        except CalibError as error:
            raise error.of(log.name) from error
    settings = ExtractSettings(
        bits=job.settings.bits, moving=job.settings.moving is not Moving.OFF, predictor=views_by_wheels
    )
    return extract(
        log,
        job.target,
        topics=job.settings.topics,
        units=job.settings.wheel_units,
        nominal=_nominal_wheels(job),
        settings=settings,
        progress=progress,
        pictures=pictures,
    )


def _nominal_wheels(job: Job) -> tuple[float, float] | None:
    """Return the wheel radius and separation, m, that the user gave, for robots that publish only odometry."""
    nominal = job.settings.nominal
    return None if nominal is None else nominal.driver


def nominal_of(settings: Settings, drive: Correspondences) -> Nominal | None:
    """Return the nominal wheels that results are given against: the user's, else those that the log gives."""
    source = drive.source
    if settings.nominal is not None or min(source.nominal_radius, source.nominal_separation) <= 0:
        return settings.nominal
    return Nominal(wheel_radius=source.nominal_radius, wheel_separation=source.nominal_separation, source=source.log)


def placed(drive: Correspondences, target: Target) -> Correspondences:
    """Return a drive with its landmarks where the target has them: as measured, say, after the log was read.

    Raises
    ------
    CalibError
        If the drive saw tags that the target does not carry.
    """
    try:
        stops = tuple(_on(target, stop) for stop in drive.stops)
        moving = tuple(_on(target, frame) for frame in drive.moving)
    except KeyError as error:
        raise CalibError(
            f"tag {error} was seen, the target does not carry it",
            remedy="give the target.json that the log was read with",
        ) from error
    return replace(drive, stops=stops, moving=moving, source=replace(drive.source, target_sha256=target_sha256(target)))


def _on(target: Target, seen: Seen) -> Seen:
    """Return what was seen with its landmarks where the target has them; itself where they are there already."""
    p_box = target.p_box(seen.landmark_ids)
    return seen if np.array_equal(p_box, seen.p_box) else replace(seen, p_box=p_box)


def at_box(drive: Correspondences, target: Target, *, given: bool) -> Correspondences:
    """Return a drive with its landmarks on a box; where none was given they must lie on the default one already."""
    there = placed(drive, target)
    off = [np.max(np.abs(a.p_box - b.p_box), initial=0.0) for a, b in zip(drive.stops, there.stops, strict=True)]
    if not given and max(off, default=0.0) > _SAME_PLACE:
        raise CalibError(
            "its landmarks are not where the default box has them",
            source=drive.robot,
            remedy="give the target that the drive was made with",
        )
    return there
