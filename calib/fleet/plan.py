"""Plan of a run: one job a robot, with everything that speaks against it said before the work."""

import tempfile
from argparse import Namespace
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.calib.settings import CORRESPONDENCES, Job, Settings, robot_name
from boxcal.detect.log.remote.urls import is_url
from boxcal.target.box import Target


def check_options(args: Namespace) -> None:
    """Refuse options that do not go together, extras that are missing and a folder that cannot be written.

    Raises
    ------
    CalibError
        The first thing that is wrong.
    """
    robots = 1 if args.same_robot else len(args.logs)
    saved = [log.name for log in args.logs if log.suffix == CORRESPONDENCES]
    if robots > 1 and (args.rerun or args.results_mcap):
        raise CalibError(
            f"--rerun and --results-mcap show one robot, {robots} are given", remedy="give one robot's logs"
        )
    if args.cluster and (args.rerun or args.results_mcap):
        raise CalibError(
            "--rerun and --results-mcap are written where the work is done, --cluster does it elsewhere",
            remedy="leave out --cluster for this robot",
        )
    if args.rerun and find_spec("rerun") is None:
        raise CalibError(
            "--rerun needs an extra that is not installed", remedy="pip install 'boxcal[rerun]', or leave out --rerun"
        )
    if args.draw and saved:
        raise CalibError(
            f"--draw needs the images, {saved[0]} holds none", remedy="give the recording (.mcap), or leave out --draw"
        )
    if args.joint_box and (robots == 1 or args.closed_form):
        found = "one robot is given" if robots == 1 else "--closed-form does not solve for the box"
        raise CalibError(
            f"--joint-box needs several robots that are solved for by maximum likelihood: {found}",
            remedy="leave out --joint-box",
        )
    _check_cameras(args)
    if args.closed_form and args.validate:
        raise CalibError(
            "--closed-form and --validate exclude each other: the closed form claims no sigmas",
            remedy="leave one of them out",
        )
    for option, path in (("--rerun", args.rerun), ("--results-mcap", args.results_mcap)):
        if path is not None:
            _check_writable(path.parent, option)
    if not is_url(args.out):
        _check_writable(args.out, "--out")


def _check_cameras(args: Namespace) -> None:
    named = args.camera_topic or []
    if not (args.all_cameras or len(named) > 1):
        return
    if args.all_cameras and named:
        raise CalibError("--all-cameras and --camera-topic are given", remedy="leave one of them out")
    for option, given in (
        ("--closed-form", args.closed_form),
        ("--joint-box", args.joint_box),
        ("--moving on", args.moving == "on"),
        ("--camera-frame", args.camera_frame is not None),
    ):
        if given:
            raise CalibError(
                f"{option} is for robots with one camera, several are asked for",
                remedy=f"leave out {option.partition(' ')[0]}, or name one camera",
            )


def _check_writable(folder: Path, option: str) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise CalibError(
            f"cannot be written ({error.strerror or error})", source=folder, remedy=f"give another folder with {option}"
        ) from error


def plan(
    logs: Sequence[Path], *, target: Target, settings: Settings, out: Path, command: str, same_robot: bool
) -> list[Job]:
    """Return a job for each robot.

    Parameters
    ----------
    logs
        One of each robot, or all of one.
    target, settings, out, command
        As :class:`Job` has them.
    same_robot
        Whether all logs are drives of one robot.

    Raises
    ------
    CalibError
        If logs cannot be told apart by their names.
    """
    robots: list[tuple[str, tuple[Path, ...]]] = [(robot_name(log), (log,)) for log in logs]
    if same_robot:
        robots = [(robots[0][0], tuple(logs))]
    names = [name for name, _ in robots]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CalibError(
            f"several logs are named {', '.join(twice)}, a robot is called as its log",
            remedy="rename them, or give --same-robot if they are drives of one robot",
        )
    return [
        Job(robot=name, logs=own, target=target, settings=settings, out=out, command=command) for name, own in robots
    ]
