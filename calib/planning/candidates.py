"""Places to stop at: poses around the box from which enough of its tags are read, and their images' information."""

from dataclasses import dataclass
from math import atan2, ceil, hypot, pi

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.calib.planning.assumptions import Model
from boxcal.calib.planning.floor import FreeSpace
from boxcal.calib.planning.stop_information import expected_problem, picture_information
from boxcal.calib.planning.views import camera_poses, tags_by_face, tags_seen
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array, Mask
from boxcal.target.box import Target

_WELL_SEEN = 20
_FRACTION = 0.57
_DRAWN = 6
"""Poses drawn for each candidate that is wanted, at first."""
_ROUNDS = 8
_CAMERA_OFF = 0.05
"""How far the camera stays off the box, m."""


def enough_tags(target: Target) -> int:
    """Return how many tags of a face make a good stop: 20, or 57 % of those on faces with fewer than 35."""
    return min(_WELL_SEEN, ceil(_FRACTION * target.box.tags_a_face))


def good_views(target: Target, seen: Mask) -> Mask:
    """Return which views (N, T) show enough: one face well, or two faces half as well each."""
    faces = np.sort(tags_by_face(target, seen), axis=1)
    need = enough_tags(target)
    return np.asarray((faces[:, -1] >= need) | (faces[:, -2] >= need / 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class Distances:
    """Least and largest distance of the camera from the box's middle, m; None for what the camera can read."""

    nearest: float | None = None
    farthest: float | None = None


def draw_poses(
    robot: Robot,
    target: Target,
    distances: Distances,
    *,
    min_side_px: float,
    count: int,
    rng: np.random.Generator,
) -> Array:
    """Return poses (count, 3) at random around the box whose cameras look roughly at it."""
    camera, (width, height) = robot.camera, robot.image_size
    ahead, t = robot.T_body_cam[:2, 2], robot.T_body_cam[:2, 3]
    corner = hypot(target.box.width, target.box.depth) / 2
    reads = min(camera.fu, camera.fv) * target.box.tag_size / min_side_px
    nearest = distances.nearest or corner
    farthest = max(min(distances.farthest or np.inf, reads), nearest)
    distance = rng.uniform(nearest, farthest, count)
    half_view = np.arctan(min(width / camera.fu, height / camera.fv) / 2)
    seen_from = rng.uniform(-pi, pi, count)
    heading = seen_from + pi + rng.uniform(-0.6, 0.6, count) * half_view - atan2(ahead[1], ahead[0])
    c, s = np.cos(heading), np.sin(heading)
    x = distance * np.cos(seen_from) - (c * t[0] - s * t[1])
    y = distance * np.sin(seen_from) - (s * t[0] + c * t[1])
    return np.stack([x, y, heading], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """C places to stop at, and the information that each one's image would carry.

    Attributes
    ----------
    poses : (C, 3), m and rad
        x, y, heading of the body.
    seen : (C, T) bool
        Tags that are read.
    faces : (C, 4)
        How many of each face.
    pictures : (C, n + 3, n + 3)
        Information of each image on the shared unknowns and on x, y, heading.
    problem, state
        Likelihood of all these images, for what legs need of it.
    """

    poses: Array
    seen: Mask
    faces: Array
    pictures: Array
    problem: Problem
    state: State

    def __len__(self) -> int:
        return len(self.poses)


def candidates_at(model: Model, poses: Array, seen: Mask) -> Candidates:
    """Return candidates of given poses (C, 3) and tags (C, T)."""
    problem, state = expected_problem(model, poses, seen)
    return Candidates(
        poses=poses,
        seen=seen,
        faces=tags_by_face(model.target, seen),
        pictures=picture_information(model, problem, state),
        problem=problem,
        state=state,
    )


def free_poses(
    robot: Robot,
    target: Target,
    space: FreeSpace,
    distances: Distances,
    *,
    min_side_px: float,
    count: int,
    rng: np.random.Generator,
) -> tuple[Array, Mask]:
    """Return up to ``count`` poses (C, 3) on the free floor that see enough of the box, and their tags (C, T).

    Raises
    ------
    CalibError
        If there are none.
    """
    poses, tags, drawn = np.zeros((0, 3)), np.zeros((0, len(target.tag_ids)), dtype=np.bool_), _DRAWN * count
    for _ in range(_ROUNDS):
        new = draw_poses(robot, target, distances, min_side_px=min_side_px, count=drawn, rng=rng)
        new = new[space.free(new[:, :2]) & _camera_off(robot, target, new)]
        seen = tags_seen(robot, target, new, min_side_px)
        fine = good_views(target, seen)
        poses, tags = np.concatenate([poses, new[fine]]), np.concatenate([tags, seen[fine]])
        if len(poses) >= count:
            break
    if not len(poses):
        raise CalibError(
            f"no place on this floor from which its camera reads {enough_tags(target)} tags of a face "
            f"(each at least {min_side_px:g} px wide)",
            source=robot.name,
            remedy="tilt the camera towards the box, give a larger floor, a larger image or larger tags",
        )
    return poses[:count], tags[:count]


def _camera_off(robot: Robot, target: Target, poses: Array) -> Mask:
    at = camera_poses(robot, poses)[:, :2, 3]
    over = np.maximum(np.abs(at) - np.array([target.box.width, target.box.depth]) / 2, 0)
    return np.asarray(np.hypot(over[:, 0], over[:, 1]) >= _CAMERA_OFF)
