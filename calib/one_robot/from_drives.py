"""From drives that were read to the calibration: looked at, solved, judged and written."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from boxcal.calib.diagnosis.first_look import FirstLook, first_look
from boxcal.calib.errors import CalibError
from boxcal.calib.one_robot.judging import judged
from boxcal.calib.one_robot.solving import solve
from boxcal.calib.one_robot.writing import write
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import READ_FRACTION, SOLVED_FRACTION, Job, listed
from boxcal.detect.correspondences import Correspondences


def looked_and_calibrated(job: Job, drives: Sequence[Correspondences]) -> tuple[FirstLook, Calibration]:
    """Return the first look at drives of one robot, and their calibration with its verdict; nothing is written."""
    look = first_look(drives, job.target, job.settings.camera_mode)
    return look, judged(solve(job, look), look.drives, look.target)


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
    tell("solve", f"solving {sum(len(drive.stops) or len(drive.moving) for drive in drives)} stops", READ_FRACTION)
    try:
        look, result = looked_and_calibrated(job, drives)
    except CalibError as error:
        raise error.of(listed(job.logs)) from error
    tell("write", "writing the results", SOLVED_FRACTION)
    write(replace(job, target=look.target), result, look.drives, photos)
    return result


def _silent(_: str, __: str, ___: float) -> None:
    return
