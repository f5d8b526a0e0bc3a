"""One robot's part in the joint solution: it begins by itself, follows the shape, is calibrated with what others found.

These are the units of work: each takes a robot with its data and gives some 12 kB.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from boxcal.calib.diagnosis.choose import explain
from boxcal.calib.diagnosis.first_look import first_look
from boxcal.calib.diagnosis.frozen import without_frozen
from boxcal.calib.diagnosis.odd_corners import CORNERS_ODD
from boxcal.calib.diagnosis.scrambled_stops import without_scrambled
from boxcal.calib.errors import CalibError
from boxcal.calib.joint_box.block import Block
from boxcal.calib.joint_box.own_solution import OwnSolution, own_solution, settled
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.one_robot.from_drives import looked_and_calibrated
from boxcal.calib.one_robot.reading import placed, read
from boxcal.calib.one_robot.solving import options_of
from boxcal.calib.one_robot.writing import write
from boxcal.calib.results.calibration import TARGET, Calibration
from boxcal.calib.settings import Job
from boxcal.calib.uncertainty.box_size import drive_id
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.remote.drives import load_drive
from boxcal.one_thread import one_thread
from boxcal.target.arrays import Array
from boxcal.target.box import Target
from boxcal.target.errors import BoxcalError
from boxcal.target.files.target_json import target_sha256


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Member:
    """One robot of a fleet.

    Attributes
    ----------
    job
        Its logs, its box and its settings.
    drives
        What its logs hold, where that is at hand.
    saved
        Correspondences that were saved of its logs, else; without either the logs are read.
    """

    job: Job
    drives: tuple[Correspondences, ...] = ()
    saved: tuple[Path, ...] = ()

    def read(self) -> list[Correspondences]:
        """Return its drives with the landmarks as its box is described.

        Raises
        ------
        BoxcalError
            If they cannot be read, or saw another box.
        """
        if self.drives:
            return [placed(drive, self.job.target) for drive in self.drives]
        if self.saved:
            return [placed(load_drive(path), self.job.target) for path in self.saved]
        return [read(log, self.job) for log in self.job.logs]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A robot's part in the joint solution.

    Attributes
    ----------
    own
        Its solution; None if it has none.
    block
        Its information on the shape; None if it has none.
    drives
        Names of its drives.
    problem
        Why it has no part; None if it has.
    """

    own: OwnSolution | None = None
    block: Block | None = None
    drives: tuple[str, ...] = ()
    problem: BoxcalError | None = None


@one_thread()
def begin(member: Member, names: Sequence[str]) -> Part:
    """Return a robot's part at the shape that it finds by itself; what speaks against its taking part, as a problem."""
    try:
        drives = member.read()
        look = first_look(drives, member.job.target, member.job.settings.camera_mode)
        if look.target is not member.job.target:
            raise CalibError(
                "the sheets of its box are not where the description has them (turned, or in another order)",
                remedy="glue them as described, or calibrate it without --joint-box",
            )
        for finding in look.findings:
            if finding.cause == CORNERS_ODD:
                raise CalibError(finding.text, remedy="calibrate it without --joint-box")
        found = explain(fit(look.drives, look.steps, options_of(member.job))).fit
        own = own_solution(found)
        own, block = settled(own.problem(look.drives, member.job.target), own, names)
    except BoxcalError as error:
        return Part(problem=error)
    except np.linalg.LinAlgError:
        return Part(problem=CalibError("its equations cannot be solved", remedy="leave it out"))
    return Part(own=own, block=block, drives=tuple(drive_id(drive) for drive in drives))


@one_thread()
def follow(member: Member, part: Part, names: Sequence[str], shape: Array) -> Part:
    """Return a robot's part at a shape (m,) near the one of its part so far; without a block where that fails."""
    if part.own is None:
        return part
    try:
        drives = [without_scrambled(without_frozen(drive)[0])[0] for drive in member.read()]
        own, block = settled(part.own.problem(drives, member.job.target), part.own, names, shape)
    except (BoxcalError, np.linalg.LinAlgError):
        return replace(part, block=None)
    return replace(part, own=own, block=block)


def calibrated(member: Member, box: Target | BoxcalError, known_as: Target) -> Calibration | BoxcalError:
    """Return a robot's calibration as :func:`calibrate_with` makes and writes it; or why there is none."""
    if isinstance(box, BoxcalError):
        return box
    try:
        return calibrate_with(member, box, known_as)
    except BoxcalError as error:
        return error
    except np.linalg.LinAlgError:
        return CalibError("its equations cannot be solved", remedy="calibrate it by itself, which says why")
    except OSError as error:
        return CalibError(f"{error.filename or 'a file'}: {error.strerror or error}", remedy="check the folder")


@one_thread()
def calibrate_with(member: Member, box: Target, known_as: Target) -> Calibration:
    """Return a robot's calibration with a box that the others found, and write it where its job says.

    Parameters
    ----------
    member
        The robot.
    box
        The box without this robot's information about it.
    known_as
        The box of the whole fleet: results name that one.

    Raises
    ------
    BoxcalError
        If its drives do not determine the calibration with that box.
    """
    job = replace(member.job, target=box)
    drives = replace(member, job=job).read()
    look, result = looked_and_calibrated(job, drives)
    job = replace(job, target=look.target)
    name = target_sha256(known_as)
    inputs = {**result.provenance.inputs, TARGET: name}
    result = replace(result, provenance=replace(result.provenance, inputs=inputs))
    saved = [replace(d, source=replace(d.source, target_sha256=name)) for d in look.drives]
    write(job, result, saved)
    return result
