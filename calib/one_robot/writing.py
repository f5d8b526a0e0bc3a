"""A robot's results written: its folder, or a place of results at a URL, and recordings of scenes."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from boxcal.calib.exports.files import STALE_FILES, exports
from boxcal.calib.exports.foxglove.results_mcap import results_mcap
from boxcal.calib.exports.names import names_for
from boxcal.calib.exports.photographs import photographs
from boxcal.calib.exports.rerun import rerun_recording
from boxcal.calib.exports.scene import make_scene
from boxcal.calib.exports.stop_images import draw_stops, stop_jpegs
from boxcal.calib.one_robot.put_files import put_files
from boxcal.calib.one_robot.reading import nominal_of
from boxcal.calib.report.robot import FLEET_PAGE, robot_report
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.json_format import CALIBRATION, calibration_bytes
from boxcal.calib.results.stop_residuals import SeenStop, stops_seen
from boxcal.calib.settings import CORRESPONDENCES, Job
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.remote.store import put_folder
from boxcal.detect.log.remote.urls import is_url
from boxcal.target.files.atomic_write import write_atomically


def write(
    job: Job,
    result: Calibration,
    drives: Sequence[Correspondences],
    photos: Sequence[Mapping[int, bytes]] = (),
    *,
    fleet: str = FLEET_PAGE,
) -> None:
    """Write a result and what is made from it; ``calibration.json`` last, so that what it names is there.

    For ``photos`` see :func:`boxcal.calib.calibrate.calibrate_drives`; ``fleet`` is the fleet's page as the report
    names it.
    """
    settings = job.settings
    if job.out is not None and is_url(job.out):
        with tempfile.TemporaryDirectory(prefix="boxcal-") as name:
            _write_folder(Path(name), job, result, drives, photos, fleet)
            put_folder(Path(name), job.out / job.robot, last=CALIBRATION, stale=STALE_FILES)
    elif job.out is not None:
        _write_folder(job.out / job.robot, job, result, drives, photos, fleet)
    if settings.rerun is None and settings.results_mcap is None:
        return
    scene = make_scene(result, drives, job.target)
    images = stop_jpegs(job.logs, scene.stops, topics=settings.topics, units=settings.wheel_units, drives=drives)
    if settings.rerun is not None:
        write_atomically(settings.rerun, rerun_recording(scene, images))
    if settings.results_mcap is not None:
        write_atomically(settings.results_mcap, results_mcap(scene, images))


def _write_folder(  # noqa: PLR0917 - a result and where it goes
    folder: Path,
    job: Job,
    result: Calibration,
    drives: Sequence[Correspondences],
    photos: Sequence[Mapping[int, bytes]],
    fleet: str,
) -> None:
    """Write a robot's folder of results."""
    settings = job.settings
    files = dict(exports(result, nominal_of(settings, drives[0]), names_for(settings, drives[0].source)))
    if settings.report:
        seen = stops_seen(result, drives, job.target)
        pictures = _photographs(job, seen, drives, photos)
        files["report.html"] = robot_report(result, drives, job.target, photographs=pictures, fleet=fleet, seen=seen)
    if settings.draw:
        drawn = draw_stops(
            job.logs,
            job.target,
            topics=settings.topics,
            units=settings.wheel_units,
            calibration=result,
            drives=drives,
        )
        files |= {f"stops/{name}": content for name, content in drawn}
    for k, drive in enumerate(drives):
        number = f"-{k + 1}" if len(drives) > 1 else ""
        drive.save(folder / f"correspondences{number}{CORRESPONDENCES}")
    put_files(folder, {**files, CALIBRATION: calibration_bytes(result)}, () if result.rig is None else result.rig.names)


def _photographs(
    job: Job, seen: Sequence[SeenStop], drives: Sequence[Correspondences], photos: Sequence[Mapping[int, bytes]]
) -> dict[str, bytes]:
    """Return small photographs of a robot's stops, by their labels."""
    settings = job.settings
    return photographs(job.logs, seen, drives, topics=settings.topics, units=settings.wheel_units, kept=photos)
