"""The truth beside a simulated log: what a calibration of it should find."""

import json
from math import degrees
from typing import Any

from boxcal.calib.simulate.drive import Drive, DriveOptions
from boxcal.calib.simulate.recorder import JOINT_TOPIC, RecordOptions
from boxcal.calib.simulate.robot import Robot

CONVENTIONS = (
    "m, rad, s since t0_ns; world: the box's frame, z up; vehicle: x forward, y left, z up, origin on the floor under "
    "the axle's middle; camera: x right, y down, z forward, pixel (0, 0) is the centre of the top-left pixel, "
    "pu = fu (1 + kr rho^2) x/z + cu; T_a_b maps points of b to a; positive wheel angles roll forward"
)


def truth_bytes(
    robot: Robot, drive: Drive, driven: DriveOptions, recorded: RecordOptions, joint_names: tuple[str, str]
) -> bytes:
    """Return the content of ``<robot>.truth.json``."""
    document = truth_document(robot, drive, driven, recorded, joint_names)
    return (json.dumps(document, indent=1) + "\n").encode()


def truth_document(
    robot: Robot, drive: Drive, driven: DriveOptions, recorded: RecordOptions, joint_names: tuple[str, str]
) -> dict[str, Any]:
    """Return the truth of one drive as plain values.

    ``nominal`` is what a data sheet would say of the wheels: one rounded radius and a rounded distance.
    """
    camera = robot.camera
    seconds = (drive.stop_t_ns - driven.t0_ns) / 1e9
    return {
        "conventions": CONVENTIONS,
        "robot": robot.name,
        "camera": {
            "width": robot.image_size[0],
            "height": robot.image_size[1],
            **{name: float(getattr(camera, name)) for name in ("fu", "fv", "cu", "cv", "kr")},
        },
        "rR": robot.rR,
        "rL": robot.rL,
        "b": robot.b,
        "nominal": {"r": round((robot.rR + robot.rL) / 2, 3), "b": round(robot.b, 2)},
        "T_vehicle_camera": robot.T_body_cam.tolist(),
        "slip": driven.slip,
        "tick_deg": round(degrees(driven.encoder_step), 12),
        "t0_ns": driven.t0_ns,
        "camera_topic": recorded.camera_topic,
        "joint_topic": JOINT_TOPIC,
        "joint_names": list(joint_names),
        "stops": [
            {
                "t_start": float(seconds[j, 0]),
                "t_end": float(seconds[j, 1]),
                "pose": drive.stop_poses[j].tolist(),
                "wheel_angles_RL": drive.stop_phi[j].tolist(),
                "T_world_camera": drive.T_box_cam[j].tolist(),
            }
            for j in range(len(seconds))
        ],
    }
