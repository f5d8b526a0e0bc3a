"""Robots that need not be done again: their result is there, of the same logs, box, settings and program."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from boxcal.calib.fleet.results_place import ResultsPlace
from boxcal.calib.one_robot.log_identity import job_fingerprint, log_identity
from boxcal.calib.report.fleet_tables import REPORT
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.fingerprint import JOINT
from boxcal.calib.results.json_format import CALIBRATION, load_calibration
from boxcal.calib.results.provenance import plain_settings
from boxcal.calib.results.without_drive import without_drive
from boxcal.calib.settings import Job, Outcome
from boxcal.target.errors import BoxcalError
from boxcal.target.files.target_json import target_sha256

_AT_ONCE = 16
"""Logs whose hashes are computed, or asked for, at once."""


def unchanged(jobs: Sequence[Job], place: ResultsPlace, *, joint: bool) -> tuple[list[Outcome], dict[str, str]]:
    """Return the outcomes of robots that need not be done again, and why each other one is done, by its name.

    Parameters
    ----------
    jobs
        The robots.
    place
        Where results are, with what it holds of earlier runs.
    joint
        Whether a result with the box that all robots solved together counts too.
    """
    with ThreadPoolExecutor(_AT_ONCE) as threads:
        looks = threads.map(lambda job: _look(job, place, joint=joint), jobs)
        found = list(zip(jobs, looks, strict=True))
    kept = [Outcome(job=job, calibration=look) for job, look in found if isinstance(look, Calibration)]
    return kept, {job.robot: look for job, look in found if isinstance(look, str)}


def _look(job: Job, place: ResultsPlace, *, joint: bool) -> Calibration | str:
    """Return the result that a robot has already, or why it has none that would come out again."""
    path = place.folder / job.robot / CALIBRATION
    if job.out is None or not path.is_file():
        return "no result yet"
    try:
        calibration = load_calibration(path)
        why = _why_anew(job, calibration, place, joint=joint)
    except BoxcalError as error:
        return f"cannot be compared: {error.found}"
    return why or without_drive(calibration)


def _why_anew(job: Job, calibration: Calibration, place: ResultsPlace, *, joint: bool) -> str:
    """Return why a result is not what would come out now, empty if it is; what is cheap to see comes first."""
    origin, folder = calibration.provenance, place.folder / job.robot
    mark = origin.fingerprint.removesuffix(JOINT)
    by_itself = mark == origin.fingerprint
    if not mark:
        return "its log is of a kind that nothing tells from another"
    if not by_itself and not joint:
        return "its result is of a run with --joint-box"
    if origin.settings != plain_settings(asdict(job.settings)):
        return "other settings"
    if by_itself and origin.target != target_sha256(job.target):
        return "another box, or the box measured anew"
    if missing := _files_missing(job, place, folder):
        return missing
    now = job_fingerprint(job, [log_identity(log) for log in job.logs])
    return "" if now == mark else "another log, or another version of the program"


def _files_missing(job: Job, place: ResultsPlace, folder: Path) -> str:
    """Return why files have to be written again, empty if none: those outside the folder may be another robot's."""
    if job.settings.rerun is not None or job.settings.results_mcap is not None:
        return "--rerun and --results-mcap are written anew"
    if place.folder == place.out and not all(path.exists() for path in _expected(job, folder)):
        return "files are missing in its folder"
    return ""


def _expected(job: Job, folder: Path) -> Iterator[Path]:
    """Yield files that a finished robot has, as its settings ask for."""
    yield folder / "camera_info.yaml"
    settings = job.settings
    if settings.report:
        yield folder / REPORT
    if settings.draw:
        yield folder / "stops"
