"""One robot's calibration as a call that an engine makes, here or on another machine."""

import platform
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from boxcal.calib.calibrate import calibrate_robot
from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.engine.telling import tell
from boxcal.calib.likelihood.compiled.compilation import prepare_detector
from boxcal.calib.one_robot.log_identity import may_be_read
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.without_drive import without_drive
from boxcal.calib.settings import Job, Stage, listed
from boxcal.detect.log.remote.urls import is_url
from boxcal.target.errors import BoxcalError
from boxcal.target.files.atomic_write import clear_parts


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """Outcome of one robot without its job, as it travels (see :class:`boxcal.calib.settings.Outcome`).

    Attributes
    ----------
    calibration, error, details, seconds
        As the outcome has them.
    files
        The robot's files by their names, where they are written by who asked for the work; else empty.
    """

    calibration: Calibration | None = None
    error: BoxcalError | None = None
    details: str = ""
    seconds: float = 0.0
    files: Mapping[str, bytes] = field(default_factory=dict)


def attempt(job: Job) -> Attempt:
    """Return what becomes of one robot, whatever happens: one bad robot never hides the others.

    Raises
    ------
    MemoryError
        If there is no memory left: there may be some elsewhere, or later.
    """
    start = time.monotonic()
    calibration: Calibration | None = None
    error: BoxcalError | None = None
    details = ""
    try:
        if any(map(may_be_read, job.logs)):
            _compile_once()
        clear_results(job)
        calibration = without_drive(calibrate_robot(job, tell))
    except MemoryError:
        raise
    except (BoxcalError, OSError) as problem:
        error = plain_error(problem, job)
    except Exception as problem:  # our own bug: reported in full with the other robots calibrated
        found = f"unexpected {type(problem).__name__}: {problem}"
        error = CalibError(found, source=listed(job.logs), remedy="please report it")
        details = traceback.format_exc()
    return Attempt(calibration=calibration, error=error, details=details, seconds=time.monotonic() - start)


def attempt_elsewhere(job: Job) -> Attempt:
    """Return what becomes of one robot on a machine that need not see its folder of results: with its files.

    A place of results behind a URL gets them from here. MemoryError as for :func:`attempt`.
    """
    missing = [log for log in job.logs if not is_url(log) and not log.exists()]
    if missing:
        error = CalibError(
            f"cannot be seen by the cluster's worker on {platform.node()}",
            source=listed(missing),
            remedy="give its URL, or put it into a folder that all workers see",
        )
        return Attempt(error=error)
    if job.out is None or is_url(job.out):
        return attempt(job)
    with tempfile.TemporaryDirectory(prefix="boxcal-") as name:
        found = attempt(replace(job, out=Path(name)))
        folder = Path(name) / job.robot
        files = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    return replace(found, files=files if found.calibration is not None else {})


def plain_error(problem: BoxcalError | OSError, job: Job) -> BoxcalError:
    """Return what went wrong with a robot's files as an error of one line that names its logs."""
    if isinstance(problem, BoxcalError):
        return problem
    where = f"{listed(job.logs)}: {problem.filename or 'a file'}"
    return CalibError(str(problem.strerror or problem), source=where)


def clear_results(job: Job) -> None:
    """Remove what was left half written by who worked on a robot until they were ended."""
    if job.out is not None and not is_url(job.out):
        clear_parts(job.out / job.robot)


def compiling(text: str) -> Stage:
    """Return the stage in which code is compiled, for all robots."""
    return Stage(robot="all robots", name="compile", text=text, share=0.0)


@cache
def _compile_once() -> None:
    """Have compiled code made ready in this process, once."""
    prepare_detector(lambda text: tell(compiling(text)))
