"""One robot: its logs are read, its calibration is solved for, judged and written."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from boxcal.calib.assessment.verdict import judge
from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.diagnosis.first_look import FirstLook, first_look
from boxcal.calib.diagnosis.last_look import last_look
from boxcal.calib.errors import CalibError
from boxcal.calib.exports.files import STALE_FILES, exports
from boxcal.calib.exports.foxglove.results_mcap import results_mcap
from boxcal.calib.exports.names import names_for
from boxcal.calib.exports.photographs import photographs, small_jpeg
from boxcal.calib.exports.rerun import rerun_recording
from boxcal.calib.exports.scene import make_scene
from boxcal.calib.exports.stop_images import draw_stops, stop_jpegs
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.calib.likelihood.estimator import negative_wheels, unsolvable
from boxcal.calib.report.robot import FLEET_PAGE, robot_report
from boxcal.calib.results.build import closed_form, refined
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.json_format import CALIBRATION, calibration_bytes
from boxcal.calib.results.provenance import provenance
from boxcal.calib.results.stop_residuals import stops_seen
from boxcal.calib.settings import CORRESPONDENCES, Job, Nominal, Progress, Settings, Stage, listed, robot_name
from boxcal.calib.uncertainty.box_size import box_notes
from boxcal.calib.uncertainty.convergence import grow
from boxcal.calib.uncertainty.cross_validation import validate
from boxcal.detect.correspondences import Correspondences, load_correspondences, taken_as
from boxcal.detect.extract import ExtractSettings, Pictures, extract
from boxcal.detect.image.bit_depth import DeepGrey, eight_bits
from boxcal.detect.log.remote.store import put_folder
from boxcal.detect.log.remote.urls import is_url
from boxcal.detect.log.wheel_samples import WheelUnits
from boxcal.one_thread import one_thread
from boxcal.target.box import Target, make_target
from boxcal.target.files.atomic_write import write_atomically, write_together
from boxcal.target.files.target_json import load_target, target_sha256

_SAME_FOCAL, _SAME_SEPARATION = 0.03, 0.4
"""How far focal length and wheel separation of one robot's drives may differ, relative; slip makes the closed form's
wheels rough."""

_SAME_PLACE = 1e-6
"""How far a landmark may lie from where a box has it, m: rounding only."""

_NOT_TOLD = 0.3
"""Relative standard deviation of a wheel's size from which on an estimate tells nothing of the wheels."""

_READ, _SOLVED = 0.7, 0.95
"""Shares of a robot's work, by measurement on logs of 20 stops: reading takes most of it."""

_MOST_PHOTOGRAPHS = 60
"""Photographs kept while a log is read: of longer drives the few that the report shows are read again."""

Source = str | Path | Correspondences
"""What a drive is read from: a recording (MCAP), correspondences saved before (``.npz``), or correspondences."""


@one_thread()
def calibrate(
    source: Source | Sequence[Source],
    target: Target | str | Path | None = None,
    *,
    settings: Settings | None = None,
    robot: str | None = None,
) -> Calibration:
    """Return the calibration of one robot from its drive, with its verdict; nothing is written.

    Parameters
    ----------
    source
        The drive, or several drives of one robot around the same box, which are solved together.
    target
        The box, or its ``target.json``; the default box as designed if not given.
    settings
        Camera model, priors, topics and more; the defaults if not given.
    robot
        Name of the robot; that of the first drive if not given.

    Raises
    ------
    BoxcalError
        If a drive cannot be used, does not determine the calibration, or saw another box.

    Examples
    --------
    >>> import boxcal
    >>> found = boxcal.calibrate("robots/r01.mcap", "box/target.json")
    >>> found.robot, found.camera_matrix.shape, found.T_body_cam.shape
    ('r01', (3, 3), (4, 4))
    """
    sources = [source] if isinstance(source, (str, Path, Correspondences)) else list(source)
    if not sources:
        raise CalibError("no drive was given", remedy="give a recording or correspondences")
    box = target if isinstance(target, Target) else load_target(target) if target is not None else make_target()
    paths = tuple(Path(s.source.log or s.robot) if isinstance(s, Correspondences) else Path(s) for s in sources)
    first = sources[0]
    name = robot or (first.robot if isinstance(first, Correspondences) else robot_name(paths[0]))
    job = Job(robot=name, logs=paths, target=box, settings=settings or Settings(report=False), out=None)
    drives = [
        _at_box(s, box, given=target is not None) if isinstance(s, Correspondences) else read(path, job)
        for s, path in zip(sources, paths, strict=True)
    ]
    look = first_look(drives, box, job.settings.camera_mode)
    result = solve(job, look)
    return _judged(result, look.drives, look.target)


def _judged(result: Calibration, drives: Sequence[Correspondences], target: Target) -> Calibration:
    """Return a result with what a user should know of its logs, and with its verdict."""
    several = len(drives) > 1
    notes = [f"{d.source.log}: {note}" if several else note for d in drives for note in d.source.notes]
    result = replace(result, notes=(*notes, *result.notes))
    return replace(result, verdict=judge(result, drives, target))


def _at_box(drive: Correspondences, target: Target, *, given: bool) -> Correspondences:
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


def calibrate_robot(job: Job, progress: Progress | None = None) -> Calibration:
    """Return the calibration of one robot, with its verdict, and write it where the job says.

    Raises
    ------
    DetectError, TargetError, CalibError
        If a log cannot be used or the drives do not determine the calibration.
    OSError
        If the result cannot be written.
    """

    def tell(name: str, text: str, share: float) -> None:
        if progress is not None:
            progress(Stage(robot=job.robot, name=name, text=text, share=share))

    if any(log.suffix != CORRESPONDENCES for log in job.logs):
        prepare_all(lambda text: tell("compile", text, 0.0))
    drives: list[Correspondences] = []
    photos: list[dict[int, bytes]] = [{} for _ in job.logs]
    shown = job.out is not None and job.settings.report
    for k, log in enumerate(job.logs):
        tell("read", f"reading {log.name}", _READ * k / len(job.logs))
        keep = partial(_photographed, photos[k]) if shown else None
        drives.append(read(log, job, partial(_reading, tell, k, len(job.logs)), keep))
    return calibrate_drives(job, drives, tell, photos)


def _photographed(photos: dict[int, bytes], t_ns: int, frame: DeepGrey) -> None:
    if len(photos) < _MOST_PHOTOGRAPHS:
        photos[t_ns] = small_jpeg(eight_bits(frame))


def calibrate_drives(
    job: Job,
    drives: Sequence[Correspondences],
    tell: Callable[[str, str, float], None] | None = None,
    photos: Sequence[Mapping[int, bytes]] = (),
) -> Calibration:
    """Return the calibration of one robot from drives that were read already, and write it where the job says.

    ``photos`` are small photographs of each drive, by the time (ns) at which their stops began; others are taken from
    the logs. Errors as for :func:`calibrate_robot`.
    """
    tell = tell or _silent
    tell("solve", f"solving {sum(len(drive.stops) for drive in drives)} stops", _READ)
    try:
        look = first_look(drives, job.target, job.settings.camera_mode)
        job, drives = replace(job, target=look.target), list(look.drives)
        result = solve(job, look)
    except CalibError as error:
        raise error.of(listed(job.logs)) from error
    result = _judged(result, drives, job.target)
    tell("write", "writing the results", _SOLVED)
    write(job, result, drives, photos)
    return result


def _silent(_: str, __: str, ___: float) -> None:
    return


def _reading(tell: Callable[[str, str, float], None], log: int, logs: int, text: str, share: float) -> None:
    """Tell what share of a robot's work is done once a share of one of its logs is read."""
    tell("read", text, _READ * (log + share) / logs)


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
    settings = ExtractSettings(bits=job.settings.bits)
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
    """Return the nominal wheels that results are given against: the user's, else those that the log tells."""
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
        stops = tuple(replace(stop, p_box=target.p_box(stop.landmark_ids)) for stop in drive.stops)
    except KeyError as error:
        raise CalibError(
            f"tag {error} was seen, the target does not carry it",
            remedy="give the target.json that the log was read with",
        ) from error
    return replace(drive, stops=stops, source=replace(drive.source, target_sha256=target_sha256(target)))


def solve(job: Job, look: FirstLook) -> Calibration:
    """Return the calibration that drives of one robot give after the four steps: by the likelihood, unless it is off.

    Raises
    ------
    CalibError
        If they do not determine it.
    """
    settings, drives, steps = job.settings, look.drives, look.steps
    _check_one_robot(job, steps)
    origin = provenance(job.command, drives, asdict(settings))
    if settings.closed_form:
        return closed_form(job.robot, drives, steps, origin, findings=look.findings)
    try:
        found, options = _likelihood(replace(job, target=look.target), drives, steps)
    except np.linalg.LinAlgError as error:
        raise unsolvable(sum(len(drive.stops) for drive in drives), error) from error
    except CalibError as error:
        raise _said_with_start(error, steps) from error
    _check_told(found, steps)
    found = replace(found, findings=(*look.findings, *found.findings, *last_look(look, found)))
    held_out = validate(drives, steps, options, found) if settings.validate else None
    grown = grow(drives[0], steps[0], found, options) if settings.report and len(drives) == 1 else ()
    return refined(job.robot, drives, steps, found, origin, validation=held_out, growth=grown)


def _said_with_start(error: CalibError, steps: Sequence[FourSteps]) -> CalibError:
    """Return why the likelihood fails, after why the four steps did where they found no answer either."""
    why = _why_replaced(steps)
    if not why:
        return error
    return CalibError(
        f"{why}; the likelihood, started from consecutive stops instead: {error.found}",
        source=error.source,
        needed=error.needed,
        remedy=error.remedy,
    )


def _why_replaced(steps: Sequence[FourSteps]) -> str:
    return next((step.replaced for step in steps if step.replaced), "")


def _check_told(found: Estimate, steps: Sequence[FourSteps]) -> None:
    """Refuse wheels of no size, and those of which nothing is told where the four steps found no answer before."""
    why = _why_replaced(steps)
    wheels = {"rR": found.rR, "rL": found.rL, "b": found.b}
    if min(wheels.values()) <= 0:
        raise _said_with_start(negative_wheels(sum(len(drive.stops) for drive in found.drives)), steps)
    sigma = max(found.sigma[name] / value for name, value in wheels.items())
    if why and not sigma < _NOT_TOLD:
        raise CalibError(
            f"{why}; the likelihood, started from consecutive stops instead, tells the wheels to "
            f"{min(sigma, 1e3):.0%} only",
            remedy="check that wheels and pictures are of the same drive, that the box stood still, and drive again",
        )


def _likelihood(
    job: Job, drives: Sequence[Correspondences], steps: Sequence[FourSteps]
) -> tuple[Estimate, EstimateOptions]:
    """Return the maximum likelihood estimate, and the options that it was made with."""
    settings = job.settings
    options = EstimateOptions(
        lens=settings.lens,
        rigid_floor=settings.rigid_floor,
        tilt_sigma=settings.tilt_prior,
        ink_sigma=settings.ink_prior,
        scale_sigma=settings.scale_prior,
        size_sigma=settings.size_prior,
        face_sigma=settings.face_prior,
        bow_sigma=settings.bow_prior,
        encoder_step=settings.encoder_step,
        slip=settings.slip,
        target=job.target,
    )
    found, options = estimate_explained(drives, steps, options)
    return replace(found, notes=found.notes + box_notes(job.target)), options


def _check_one_robot(job: Job, steps: Sequence[FourSteps]) -> None:
    """Refuse drives of different robots: what the four steps find in each is too far apart for one."""
    for log, step in zip(job.logs[1:], steps[1:], strict=True):
        for what, found, first, limit in (
            ("focal length", step.camera.camera.fu, steps[0].camera.camera.fu, _SAME_FOCAL),
            ("wheel separation", step.mounting.b, steps[0].mounting.b, _SAME_SEPARATION),
        ):
            if abs(found / first - 1) > limit:
                raise CalibError(
                    f"not drives of one robot with one lens setting: {what} {found:.4g}, "
                    f"{listed(job.logs[:1])} has {first:.4g}",
                    source=listed([log]),
                    remedy="leave it out or calibrate each by itself",
                )


def write(
    job: Job, result: Calibration, drives: Sequence[Correspondences], photos: Sequence[Mapping[int, bytes]] = ()
) -> None:
    """Write a result and what is made from it; ``calibration.json`` last, so that what it names is there.

    For ``photos`` see :func:`calibrate_drives`.
    """
    settings = job.settings
    if job.out is not None and is_url(job.out):
        with tempfile.TemporaryDirectory(prefix="boxcal-") as name:
            _write_folder(Path(name), job, result, drives, photos)
            put_folder(Path(name), job.out / job.robot, last=CALIBRATION, stale=STALE_FILES)
    elif job.out is not None:
        _write_folder(job.out / job.robot, job, result, drives, photos)
    if settings.rerun is None and settings.results_mcap is None:
        return
    scene = make_scene(result, drives, job.target)
    images = stop_jpegs(job.logs, scene.stops, topics=settings.topics, units=settings.wheel_units, drives=drives)
    if settings.rerun is not None:
        write_atomically(settings.rerun, rerun_recording(scene, images))
    if settings.results_mcap is not None:
        write_atomically(settings.results_mcap, results_mcap(scene, images))


def _write_folder(
    folder: Path,
    job: Job,
    result: Calibration,
    drives: Sequence[Correspondences],
    photos: Sequence[Mapping[int, bytes]],
) -> None:
    """Write a robot's folder of results."""
    settings = job.settings
    files = dict(exports(result, nominal_of(settings, drives[0]), names_for(settings, drives[0].source)))
    if settings.report:
        files["report.html"] = robot_report(
            result, drives, job.target, photographs=_photographs(job, result, drives, photos), fleet=FLEET_PAGE
        )
    if settings.draw:
        pictures = draw_stops(
            job.logs,
            job.target,
            topics=settings.topics,
            units=settings.wheel_units,
            calibration=result,
            drives=drives,
        )
        files |= {f"stops/{name}": content for name, content in pictures}
    for k, drive in enumerate(drives):
        number = f"-{k + 1}" if len(drives) > 1 else ""
        drive.save(folder / f"correspondences{number}{CORRESPONDENCES}")
    write_together(folder, {**files, CALIBRATION: calibration_bytes(result)})
    (folder / "static_transform.sh").chmod(0o755)
    for name in STALE_FILES:
        if name not in files:
            (folder / name).unlink(missing_ok=True)


def _photographs(
    job: Job, result: Calibration, drives: Sequence[Correspondences], photos: Sequence[Mapping[int, bytes]]
) -> dict[str, bytes]:
    """Return small photographs of a robot's stops, by their labels."""
    settings = job.settings
    seen = stops_seen(result, drives, job.target)
    return photographs(job.logs, seen, drives, topics=settings.topics, units=settings.wheel_units, kept=photos)
