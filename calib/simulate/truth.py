"""The truth beside a simulated log: what a calibration of it should find."""

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from math import degrees, hypot
from typing import Any

from boxcal.calib.simulate.drive import Drive, DriveOptions
from boxcal.calib.simulate.imperfections import BoxFaults, WheelFaults
from boxcal.calib.simulate.recorder import JOINT_TOPIC, RecordOptions, View
from boxcal.calib.simulate.robot import Robot
from boxcal.target.box import FACES
from boxcal.target.camera.camera_model import CameraKind

CONVENTIONS = (
    "m, rad, s since t0_ns; world: the box's frame, z up; vehicle: x forward, y left, z up, origin on the floor under "
    "the axle's middle; camera: x right, y down, z forward, pixel (0, 0) is the centre of the top-left pixel, "
    "pu = fu (1 + kr rho^2) x/z + cu; T_a_b maps points of b to a; positive wheel angles roll forward"
)


def truth_bytes(
    robot: Robot,
    drive: Drive,
    driven: DriveOptions,
    recorded: RecordOptions,
    joint_names: tuple[str, str],
    *,
    note: str = "",
    others: Sequence[View] = (),
) -> bytes:
    """Return the content of ``<robot>.truth.json``; ``note`` says in words what was not exact."""
    document = truth_document(robot, drive, driven, recorded, joint_names, note=note)
    if others:
        document["cameras"] = [_camera_document(view) for view in others]
    return (json.dumps(document, indent=1) + "\n").encode()


def truth_document(
    robot: Robot,
    drive: Drive,
    driven: DriveOptions,
    recorded: RecordOptions,
    joint_names: tuple[str, str],
    *,
    note: str = "",
) -> dict[str, Any]:
    """Return the truth of one drive as plain values.

    ``nominal`` is what a data sheet would say of the wheels: one rounded radius and a rounded distance.
    """
    camera = robot.camera
    seconds = (drive.stop_t_ns - driven.t0_ns) / 1e9
    faults = faults_document(drive, note)
    faults["camera_stamp_offset_s"] += recorded.late_s
    shutter = {name: getattr(recorded, name) for name in ("clock_rate", "clock_jump_s", "jitter_s", "readout_s")}
    if recorded.wheels_jump_s:
        faults["wheels_clock_jump_s"] = recorded.wheels_jump_s
    faults["camera_faults"] |= {name: value for name, value in shutter.items() if value}
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
        "slip": drive.faults.wheels.slip,
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
        **faults,
    }


def _camera_document(view: View) -> dict[str, Any]:
    """Return a further camera: what its images, its lens and its place are."""
    camera, (width, height) = view.robot.camera, view.robot.image_size
    return {
        "topic": view.options.camera_topic,
        "width": width,
        "height": height,
        "model": str(camera.kind),
        **{name: float(getattr(camera, name)) for name in ("fu", "fv", "cu", "cv", "kr")},
        "further": camera.further,
        "T_vehicle_camera": view.robot.T_body_cam.tolist(),
        "camera_stamp_offset_s": view.options.late_s,
    }


def faults_document(drive: Drive, note: str) -> dict[str, Any]:
    """Return what was not exact, as plain values: m, degrees, fractions; sheets and faces as seen from outside."""
    faults = drive.faults
    camera = drive.scene.cameras[0]
    plain = camera.kind is CameraKind.RADIAL
    return {
        "note": note,
        "model": str(CameraKind.BROWN if plain else camera.kind),
        "k": [*camera.distortion, *([0.0] * 4 if plain else [])],
        "lean_deg": degrees(faults.lean),
        "tilt": [degrees(t) for t in faults.tilt],
        "slip_true": faults.wheels.slip,
        "camera_stamp_offset_s": faults.camera.late,
        "camera_stamp_drift": faults.camera.drift,
        "box": _box_document(faults.box),
        "wheel": _wheel_document(faults.wheels),
        "camera_faults": {
            name: getattr(faults.camera, name)
            for name in ("knocked", "focus", "autofocus")
            if getattr(faults.camera, name)
        },
    }


def _box_document(box: BoxFaults) -> dict[str, Any]:
    document: dict[str, Any] = {}
    if box.scale != (1.0, 1.0):
        document["scale"] = list(box.scale)
    if box.place is not None:
        document["shift"] = {str(f): [float(p[0]), -float(p[1])] for f, p in enumerate(box.place)}
        document["glue"] = {str(f): -degrees(p[2]) for f, p in enumerate(box.place)}
    if box.pose is not None:
        document["tip"] = {str(f): degrees(p[0]) for f, p in enumerate(box.pose)}
        document["turn"] = {str(f): degrees(p[1]) for f, p in enumerate(box.pose)}
        document["out"] = {str(f): float(p[5]) for f, p in enumerate(box.pose)}
    if any(box.bow):
        document["bow"] = box.bow[0] if len(set(box.bow)) == 1 else list(box.bow)
    if box.moved is not None:
        stop, x, y, about = box.moved
        document["moved"] = [stop, hypot(x, y), degrees(about)]
        document["moved_along"] = [x, y]
    if box.order != tuple(range(FACES)):
        document["order"] = list(box.order)
    if box.turned:
        document["upside_down"] = list(box.turned)
    if box.standing is not None:
        document["T_floor_box"] = box.standing.tolist()
    if box.other is not None:
        document["other"] = asdict(box.other)
    return document


def _wheel_document(wheels: WheelFaults) -> dict[str, Any]:
    sound = WheelFaults(slip=wheels.slip)
    document = {
        name: getattr(wheels, name)
        for name in (f.name for f in fields(WheelFaults))
        if getattr(wheels, name) != getattr(sound, name)
    }
    if "eccentric" in document:
        document["ecc"] = max(hypot(*wheels.eccentric[:2]), hypot(*wheels.eccentric[2:]))
    return document
