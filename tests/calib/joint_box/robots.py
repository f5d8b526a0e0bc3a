"""Robots that drive around one box made by hand, as correspondences, solved each by itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians

import numpy as np

from boxcal.calib.diagnosis.first_look import first_look
from boxcal.calib.geometry.so3_se3 import exp_se3, log_so3
from boxcal.calib.joint_box.block import Block
from boxcal.calib.joint_box.gauge import gauge_free
from boxcal.calib.joint_box.own_solution import OwnSolution, own_solution, settled
from boxcal.calib.joint_box.shape_prior import ShapePrior, shape_prior
from boxcal.calib.likelihood import CameraKind, EstimateOptions
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfect_drive import ImperfectDrive, imperfect_drive
from boxcal.calib.simulate.imperfections import BoxFaults, CameraFaults, Imperfections, WheelFaults
from boxcal.calib.simulate.robot import random_robot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, make_target

TARGET = make_target()
STOPS = 8


def hand_made_box(seed: int) -> BoxFaults:
    """Return a box whose sheets are off by 0.3 mm, its faces by 0.5 mm and 0.3 deg, its print by 0.1 %."""
    rng = np.random.default_rng(seed)
    place, pose = np.zeros((FACES, 3)), np.zeros((FACES, 6))
    place[:, :2] = 3e-4 * rng.standard_normal((FACES, 2))
    pose[:, :3], pose[:, 3:] = radians(0.3) * rng.standard_normal((FACES, 3)), 5e-4 * rng.standard_normal((FACES, 3))
    return BoxFaults(scale=(1.001, 0.999), place=place, pose=pose)


def drive_of(number: int, box: BoxFaults) -> ImperfectDrive:
    """Return the drive of one robot of a fleet around a box."""
    faults = Imperfections(wheels=WheelFaults(slip=3e-4), camera=CameraFaults(noise=0.05), box=box, lean=radians(0.03))
    robot = random_robot(f"r{number:02d}", np.random.default_rng([5, number]))
    return imperfect_drive(robot, TARGET, DriveOptions(stops=STOPS), faults, np.random.default_rng([6, number]))


def shape_of_box(box: BoxFaults, names: Sequence[str]) -> Array:
    """Return the true values of the shape's unknowns, (m,)."""
    true = {"scale_x": box.scale[0] - 1, "scale_y": box.scale[1] - 1, "seat": 0.0}
    assert box.place is not None
    assert box.pose is not None
    for f in range(FACES):
        sheet = np.eye(4)
        sheet[:2, 3] = box.place[f, :2]
        T = exp_se3(box.pose[f]) @ sheet
        turn = log_so3(T[:3, :3])
        true |= {f"face{f}_t{a}": T[k, 3] for k, a in enumerate("xyz")}
        true |= {f"face{f}_r{a}": turn[k] for k, a in enumerate("xyz")} | {f"bow{f}": box.bow[f]}
    return np.array([true[name] for name in names])


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Some robots with their solutions, each by itself, and their first blocks."""

    drives: list[Correspondences]
    prior: ShapePrior
    owns: list[OwnSolution]
    first: list[Block]

    def ask(self, shape: Array, tolerance: float = 1e-20) -> list[Block]:
        """Return the robots' blocks at a shape."""
        out = []
        for k, (drive, own) in enumerate(zip(self.drives, self.owns, strict=True)):
            problem = own.problem([drive], TARGET)
            self.owns[k], block = settled(problem, own, self.prior.names, shape, tolerance)
            out.append(block.projected(gauge_free(self.prior, shape)))
        return out


def fleet(boxes: Sequence[BoxFaults]) -> Fleet:
    """Return a fleet of one robot a box."""
    options = EstimateOptions(target=TARGET, lens=CameraKind.RADIAL)
    prior = shape_prior(options)
    drives, owns, first = [], [], []
    for number, box in enumerate(boxes):
        look = first_look([drive_of(number, box).seen], TARGET)
        own = own_solution(fit(look.drives, look.steps, options))
        own, block = settled(own.problem(look.drives, TARGET), own, prior.names)
        drives.append(look.drives[0])
        owns.append(own)
        first.append(block)
    return Fleet(drives=drives, prior=prior, owns=owns, first=first)
