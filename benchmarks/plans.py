"""Which stops to drive to: of many random plans the one that promises most, by the Cramer-Rao bound."""

from dataclasses import replace

import numpy as np
from runs import TRANSLATION, WHEELS, Setting, drive, true_values

from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.calib.uncertainty.cramer_rao import Truth, cramer_rao
from boxcal.target.arrays import Array
from boxcal.target.box import Target


def best_plan(robot: Robot, target: Target, setting: Setting, tries: int) -> Array:
    """Return stops (P, 3), x, y (m), heading (rad): the largest relative bound of rR, rL, b and t is smallest.

    The wheels' bounds count ten times, since 0.1 % is asked of them and 1 % of the camera extrinsics.
    """
    clearance = DriveOptions().clearance + robot.reach
    plans = [choose_stops(robot, target, setting.stops, clearance, np.random.default_rng([5, k])) for k in range(tries)]
    return min(plans, key=lambda plan: _promise(robot, target, setting, plan))


def _promise(robot: Robot, target: Target, setting: Setting, plan: Array) -> float:
    driven, seen = drive(robot, target, replace(setting, plan=plan), np.random.default_rng(0))
    truth = Truth.of(robot, driven.stop_poses, slip=setting.slip, encoder_step=setting.encoder_step)
    sigma = np.sqrt(np.diag(cramer_rao([seen], truth)))
    true = true_values(robot)
    wheels = np.max(sigma[WHEELS] / true[WHEELS])
    return float(max(10 * wheels, np.linalg.norm(sigma[TRANSLATION]) / np.linalg.norm(true[TRANSLATION])))
