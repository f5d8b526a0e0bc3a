"""A camera that was knocked more than once in a drive."""

from dataclasses import replace
from math import radians

import numpy as np

from boxcal.calib.calibrate import calibrate
from boxcal.calib.geometry.so3_se3 import exp_se3
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.imperfect_drive import hand_made, seen_from
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind

TARGET = make_target()


def test_both_knocks_are_solved_for_and_the_result_is_that_after_them_and_usable_at_most() -> None:
    of_drive, of_box = np.random.default_rng(4).spawn(2)
    robot, faults = turtlebot(), hand_made(of_box, lean=radians(0.02))
    faults = replace(faults, camera=replace(faults.camera, lens=(0.0, 0.0, 0.0, 0.0)))
    drive = simulate_drive(robot, TARGET, DriveOptions(stops=14), of_drive, faults=faults)
    knocks = np.zeros((14, 6))
    knocks[5:, :3] += np.radians([0.4, -0.3, 0.3])
    knocks[10:, :3] += np.radians([-0.2, 0.5, 0.5])
    there = np.array([T @ exp_se3(w) for T, w in zip(drive.scene.T_body_cam, knocks, strict=True)])
    seen = seen_from(robot, TARGET, replace(drive, scene=replace(drive.scene, T_body_cam=there)), of_drive)
    found = calibrate(seen, TARGET)
    assert found.verdict is not None
    assert found.detail is not None
    assert found.camera.kind is CameraKind.RADIAL
    said = [f for f in found.findings if f.cause == "camera-knocked"]
    assert [f.adopted for f in said] == [False, False]
    assert {len(f.stops) for f in said} == {5, 10}
    assert str(found.verdict.level) == "usable"
    turned = found.T_body_cam[:3, :3].T @ there[-1][:3, :3]
    angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
    assert angle < 0.1
