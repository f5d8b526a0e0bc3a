"""The library's call: drives of many robots in, one refined box and all calibrations out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.calib.joint_box.one_of_many import Member, calibrated
from boxcal.calib.joint_box.robots import LOST, Run
from boxcal.calib.joint_box.together import JointBox, solve_box
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Job, Settings
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target
from boxcal.target.files.target_json import given_target


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RefinedFleet:
    """A fleet calibrated together.

    Attributes
    ----------
    target
        The box, refined: give it to :func:`boxcal.save_target`, and to the calibrations of other robots.
    calibrations
        With the refined box, by name.
    left_out
        Why a robot has none, by name.
    joint
        The joint solution, with all its values.
    """

    target: Target
    calibrations: Mapping[str, Calibration]
    left_out: Mapping[str, str]
    joint: JointBox


def refine_box(
    drives: Mapping[str, Correspondences],
    target: Target | str | Path | None = None,
    *,
    settings: Settings | None = None,
    run: Run = map,
) -> RefinedFleet:
    """Return the true shape of a box from the drives of many robots around it, and every robot's calibration with it.

    No calibration counts its own drive's information about the box as new.

    Parameters
    ----------
    drives
        One drive a robot, by name.
    target
        The box, or its ``target.json``; the default box as designed if not given.
    settings
        As for :func:`boxcal.calibrate`.
    run
        What does the work on many robots, like ``map``; that of a pool of processes, say.

    Raises
    ------
    BoxcalError
        If fewer than two robots can take part, or no majority of them saw one box.

    Examples
    --------
    >>> import boxcal
    >>> drives = {f"r{k}": boxcal.simulate(stops=8, seed=k).correspondences for k in range(3)}
    >>> fleet = boxcal.refine_box(drives)
    >>> sorted(fleet.calibrations), fleet.target.refined.robots
    (['r0', 'r1', 'r2'], 3)
    """
    if not drives:
        raise CalibError("no drives were given", needed="at least two robots are needed")
    box = given_target(target)
    chosen = settings or Settings(report=False)
    members = [
        Member(
            job=Job(robot=name, logs=(Path(name),), target=box, settings=chosen, out=None),
            drives=(replace(drive, robot=name),),
        )
        for name, drive in drives.items()
    ]
    joint = solve_box(members, run)
    left_out = {name: str(error) for name, error in joint.left_out.items()}
    taking = [k for k, block in enumerate(joint.blocks) if block is not None]
    boxes = (joint.without(k) for k in taking)
    results = run(calibrated, [joint.members[k] for k in taking], boxes, [joint.target] * len(taking))
    calibrations = {}
    for k, result in zip(taking, results, strict=True):
        name = joint.members[k].job.robot
        if isinstance(result, Calibration):
            calibrations[name] = result
        else:
            left_out[name] = f"helped to find the box, but has no calibration with it: {result or LOST}"
    return RefinedFleet(target=joint.target, calibrations=calibrations, left_out=left_out, joint=joint)
