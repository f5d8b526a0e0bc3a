"""One robot: its logs are read, its calibration is solved for, judged and written (see ``one_robot/``).

What is needed only once logs are read is imported then: it takes longer than to open a log.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.photographs import keeping
from boxcal.calib.likelihood.compiled.compilation import prepare_detector
from boxcal.calib.one_robot.log_identity import file_state, fingerprint_of, may_be_read
from boxcal.calib.one_robot.reading import at_box, read
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import (
    CORRESPONDENCES,
    READ_FRACTION,
    SOLVED_FRACTION,
    Job,
    Progress,
    Settings,
    Stage,
    listed,
    robot_name,
)
from boxcal.detect.correspondences import Correspondences
from boxcal.one_thread import one_thread
from boxcal.target.box import Target
from boxcal.target.files.target_json import given_target

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
    if settings is not None and settings.several_cameras:
        raise CalibError("the settings ask for several cameras", remedy="call boxcal.calibrate_cameras")
    box = given_target(target)
    paths = tuple(Path(s.source.log or s.robot) if isinstance(s, Correspondences) else Path(s) for s in sources)
    first = sources[0]
    name = robot or (first.robot if isinstance(first, Correspondences) else robot_name(paths[0]))
    job = Job(robot=name, logs=paths, target=box, settings=settings or Settings(report=False), out=None)
    drives = [
        at_box(s, box, given=target is not None) if isinstance(s, Correspondences) else read(path, job)
        for s, path in zip(sources, paths, strict=True)
    ]
    from boxcal.calib.one_robot.from_drives import looked_and_calibrated  # noqa: PLC0415 - see the top

    return looked_and_calibrated(job, drives)[1]


@one_thread()
def calibrate_cameras(
    source: str | Path | Mapping[str, Correspondences],
    target: Target | str | Path | None = None,
    *,
    cameras: Sequence[str] = (),
    settings: Settings | None = None,
    robot: str | None = None,
) -> dict[str, Calibration]:
    """Return the calibrations of a robot's cameras, solved together, by the cameras' names; nothing is written.

    Each has its own lens and extrinsics; wheels, stops and box are those of all. Every calibration's ``rig`` has all
    cameras, and the transform between any two with its covariance. Where only one camera sees the box, the result is
    as of :func:`calibrate`, and its ``rig`` says what was left out.

    Parameters
    ----------
    source
        The recording; or one drive as each camera saw it, by the cameras' names.
    target
        The box, or its ``target.json``; the default box as designed if not given.
    cameras
        Image topics of a recording's cameras; if not given those of the settings, or all that show the box.
    settings
        As for :func:`calibrate`.
    robot
        Name of the robot; that of the recording, or of the first drive, if not given.

    Raises
    ------
    BoxcalError
        If no camera can be used, or two topics that are named show one camera.

    Examples
    --------
    >>> import boxcal
    >>> found = boxcal.calibrate_cameras("robots/r01.mcap", "box/target.json")  # a robot with one camera
    >>> sorted(found), found["camera"].rig.names
    (['camera'], ('camera',))
    >>> transforms = [(pair.a, pair.b, pair.T_a_b, pair.covariance) for pair in found["camera"].rig.pairs]
    """
    from boxcal.calib.one_robot.cameras_read import CameraDrives, ReadCameras, read_cameras  # noqa: PLC0415 - see the top
    from boxcal.calib.one_robot.several_cameras import solved_and_judged  # noqa: PLC0415

    box = given_target(target)
    settings = settings or Settings(report=False)
    cameras = tuple(cameras) or settings.cameras
    chosen = replace(settings, cameras=cameras, all_cameras=not cameras)
    if isinstance(source, Mapping):
        if not source:
            raise CalibError("no drive was given", remedy="give one of each camera")
        first = next(iter(source.values()))
        name, log = robot or first.robot, Path(first.source.log or first.robot)
        placed = {camera: at_box(drive, box, given=target is not None) for camera, drive in source.items()}
        given = ReadCameras(
            cameras=tuple(
                CameraDrives(name=camera, topic=drive.source.camera_topic or camera, drives=(drive,))
                for camera, drive in placed.items()
            )
        )
        job = Job(robot=name, logs=(log,), target=box, settings=chosen, out=None)
    else:
        path = Path(source)
        job = Job(robot=robot or robot_name(path), logs=(path,), target=box, settings=chosen, out=None)
        given = read_cameras(job, lambda _, __: None, lambda _: None)
    return {camera.read.name: camera.calibration for camera in solved_and_judged(job, given)}


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

    if any(log.suffix != CORRESPONDENCES and may_be_read(log) for log in job.logs):
        prepare_detector(lambda text: tell("compile", text, 0.0))
    if job.settings.several_cameras:
        from boxcal.calib.one_robot.several_cameras import calibrate_cameras_of  # noqa: PLC0415 - see the top

        return calibrate_cameras_of(job, tell, READ_FRACTION, SOLVED_FRACTION)
    drives: list[Correspondences] = []
    photos: list[dict[int, bytes]] = [{} for _ in job.logs]
    shown = job.out is not None and job.settings.report
    for k, log in enumerate(job.logs):
        tell("read", f"reading {listed([log])}", READ_FRACTION * k / len(job.logs))
        keep = keeping(photos[k]) if shown else None
        before = file_state(log)
        drives.append(read(log, job, partial(_reading, tell, k, len(job.logs)), keep))
        if file_state(log) != before:
            raise CalibError("changed while it was read", source=log.name, remedy="close its recorder and try again")
    job = replace(job, fingerprint=fingerprint_of(job, drives))
    from boxcal.calib.one_robot.from_drives import calibrate_drives  # noqa: PLC0415 - see the top

    return calibrate_drives(job, drives, tell, photos)


def _reading(tell: Callable[[str, str, float], None], log: int, logs: int, text: str, share: float) -> None:
    """Report the fraction of a robot's work that is done once a fraction of one of its logs is read."""
    tell("read", text, READ_FRACTION * (log + share) / logs)
