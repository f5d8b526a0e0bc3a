"""Choice of stops: poses around the box from which the camera sees it well."""

from math import atan2, ceil, hypot, pi

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.route import KeepOut
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import FACES, Target
from boxcal.target.camera.camera_model import project
from boxcal.target.render.renderer import visible_tags

DECODABLE_PX = 16.0
"""Shortest side of a tag that a detector reads reliably: 2 px a module."""

_WELL_SEEN = 20
_TRIES = 400
_TWO_FACES_TRIES = 40
_TWO_FACES_FRACTION = 0.75


def decodable_tags(
    robot: Robot, target: Target, T_box_cam: Array, *, margin_px: float = 0.0, min_side_px: float = DECODABLE_PX
) -> Ids:
    """Return the ids of the tags, ascending, that are wholly in the image and large enough to be read."""
    T_cam_box = inverse(T_box_cam)
    ids = visible_tags(target, robot.camera, T_cam_box, robot.image_size, margin_px)
    corners = target.tag_corners[np.searchsorted(target.tag_ids, ids)]
    uv_px = project(robot.camera, corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
    sides = np.linalg.norm(uv_px - np.roll(uv_px, -1, axis=1), axis=2)
    return np.asarray(ids[sides.min(axis=1, initial=np.inf) >= min_side_px])


def choose_stops(robot: Robot, target: Target, count: int, gap: float, rng: np.random.Generator) -> Array:
    """Return stops (count, 3), x, y (m) and heading (rad), from which the camera sees the box well.

    They circle the box; from 8 stops on, the second half goes round in the other direction. At each the camera reads at
    least 20 tags of a face (57 % of them where a face has fewer than 35), at most of them also a second face.

    Parameters
    ----------
    gap : m
        How far the body's origin stays off the box's walls.

    Raises
    ------
    CalibError
        If no such place is found.
    """
    keep_out = KeepOut.around(target.box, gap)
    rounds = [count] if count < 8 else [ceil(count / 2), count // 2]
    sense = float(rng.choice([-1.0, 1.0]))
    stops: list[Array] = []
    for stops_a_round in rounds:
        spacing = 2 * pi / stops_a_round
        first = stops[-1] if stops else None
        start = rng.uniform(-pi, pi) if first is None else atan2(first[1], first[0])
        stops += [
            _stop(robot, target, keep_out, (start + sense * spacing * k, spacing), rng) for k in range(stops_a_round)
        ]
        sense = -sense
    return np.array(stops)


def _stop(
    robot: Robot, target: Target, keep_out: KeepOut, sector: tuple[float, float], rng: np.random.Generator
) -> Array:
    """Return one stop with the camera in a sector about the box, given by its middle and width (rad)."""
    azimuth, spacing = sector
    need = min(_WELL_SEEN, ceil(0.57 * target.box.tags_a_face))
    two_faces = rng.random() < _TWO_FACES_FRACTION
    fair: Array | None = None
    for k in range(_TRIES):
        stop = _candidate(robot, target, azimuth, min(spacing * (0.5 + k / 100), pi / 2), rng)
        if keep_out.off_box(stop[None, :2])[0] < keep_out.gap:
            continue
        T_box_cam = planar(*stop) @ robot.T_body_cam
        if keep_out.off_box(T_box_cam[None, :2, 3])[0] < 0.05:
            continue
        ids = decodable_tags(robot, target, T_box_cam, margin_px=0.02 * robot.image_size[0])
        faces = np.bincount(target.tag_faces[np.searchsorted(target.tag_ids, ids)], minlength=FACES)
        faces.sort()
        if faces[-1] < need:
            continue
        if not two_faces or faces[-2] >= need / 2:
            return stop
        fair = stop if fair is None else fair
        if k >= _TWO_FACES_TRIES:
            return fair
    if fair is not None:
        return fair
    raise CalibError(
        f"no place found from which its camera reads {need} tags of a face (each at least {DECODABLE_PX:g} px wide)",
        source=robot.name,
        remedy="tilt the camera towards the box, or use a larger image or larger tags",
    )


def _candidate(robot: Robot, target: Target, azimuth: float, spread: float, rng: np.random.Generator) -> Array:
    """Return a pose (3,) whose camera looks roughly at the box from a random distance."""
    camera, (width, height) = robot.camera, robot.image_size
    ahead, t = robot.T_body_cam[:2, 2], robot.T_body_cam[:2, 3]
    nearest = hypot(target.box.width, target.box.depth) / 2
    farthest = max(min(camera.fu, camera.fv) * target.box.tag_size / DECODABLE_PX, nearest)
    distance = rng.uniform(nearest, farthest)
    half_view = np.arctan(min(width / camera.fu, height / camera.fv) / 2)
    seen_from = azimuth + rng.uniform(-0.5, 0.5) * spread
    aim = seen_from + pi + rng.uniform(-0.5, 0.5) * half_view
    heading = aim - atan2(ahead[1], ahead[0])
    c, s = np.cos(heading), np.sin(heading)
    x = distance * np.cos(seen_from) - (c * t[0] - s * t[1])
    y = distance * np.sin(seen_from) - (s * t[0] + c * t[1])
    return np.array([x, y, heading])
