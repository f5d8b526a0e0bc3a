"""More cameras on a simulated robot: the same drive as another of its cameras sees it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan2, radians

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.drive import Drive, DriveOptions
from boxcal.calib.simulate.recorder import RecordOptions, View
from boxcal.calib.simulate.robot import Robot, mount, with_camera
from boxcal.calib.simulate.viewpoints import choose_stops
from boxcal.target.arrays import Array
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraKind, CameraModel

RIGS = ("rear", "stereo", "wide")
"""What a robot's second camera may be: one that looks in the opposite direction, one 60 mm beside the first, a
fisheye."""
BASELINE = 0.06
"""Distance of a stereo pair, m."""
_BESIDE = 0.04
_LATER_S = 0.004
"""By how much the clock of each further camera is ahead of the one before, s: no two cameras have one clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnSettings:
    """Settings that cameras of a robot have each of its own; each tuple has one for every camera, or is empty.

    Attributes
    ----------
    late_s : s
        Stamps less the middle of the exposure; if empty, each camera's are 4 ms later than those of the one before.
    image_sizes : px
        Width and height; if empty, those of the first camera.
    frames
        Images at each stop; if empty, each camera takes one more than the one before.
    """

    late_s: tuple[float, ...] = ()
    image_sizes: tuple[tuple[int, int], ...] = ()
    frames: tuple[int, ...] = ()

    def of(self, number: int, record: RecordOptions) -> RecordOptions:
        """Return how the images of a camera, from 0, are recorded, by how those of the robot are."""
        late_s = self.late_s[number] if self.late_s else record.late_s + number * _LATER_S
        frames = self.frames[number] if self.frames else record.frames + number
        return replace(record, late_s=late_s, frames=frames)


def with_images_of(robot: Robot, image_size: tuple[int, int]) -> Robot:
    """Return the robot with images of another size, px, of the same lens: the width is seen as before."""
    (width, height), (w, h) = robot.image_size, image_size
    camera, scale = robot.camera, w / width
    camera = replace(
        camera,
        fu=scale * camera.fu,
        fv=scale * camera.fv,
        cu=scale * (camera.cu + 0.5) - 0.5,
        cv=scale * (camera.cv - (height - 1) / 2) + (h - 1) / 2,
    )
    return replace(robot, camera=camera, image_size=image_size)


def with_camera_at(
    robot: Robot, T_body_cam: Array, camera: CameraModel | None = None, image_size: tuple[int, int] | None = None
) -> Robot:
    """Return the robot with another of its cameras, mounted at ``T_body_cam`` (4, 4), m.

    Lens and images are the same unless others are given.

    Examples
    --------
    >>> import numpy as np
    >>> from boxcal.calib.simulate.robot import turtlebot
    >>> left = turtlebot()
    >>> T_left_right = np.eye(4)
    >>> T_left_right[0, 3] = 0.06  # 60 mm to the right
    >>> with_camera_at(left, left.T_body_cam @ T_left_right).rR == left.rR
    True
    """
    return replace(
        robot, T_body_cam=T_body_cam, camera=camera or robot.camera, image_size=image_size or robot.image_size
    )


def seen_by(drive: Drive, robot: Robot, other: Robot) -> Drive:
    """Return a drive as another camera of its robot sees it.

    Parameters
    ----------
    drive
        The drive of ``robot``.
    robot, other
        The robot with the one camera, and with the other. What happens to the camera in the drive (a knock, another
        focus) happened to the first alone.
    """
    T_cam_other = inverse(robot.T_body_cam) @ other.T_body_cam
    stops = len(drive.stop_poses)
    scene = replace(drive.scene, T_body_cam=np.tile(other.T_body_cam, (stops, 1, 1)), cameras=(other.camera,) * stops)
    unmoved = all(np.array_equal(T, robot.T_body_cam) for T in drive.scene.T_body_cam)
    at_stops = [scene.T_box_cam(j, pose) for j, pose in enumerate(drive.stop_poses)]
    return replace(drive, scene=scene, T_box_cam=drive.T_box_cam @ T_cam_other if unmoved else np.stack(at_stops))


def further_cameras(robot: Robot, count: int, rig: str, rng: np.random.Generator, own: OwnSettings) -> dict[str, Robot]:
    """Return a robot with each of its further cameras, by their names.

    Parameters
    ----------
    robot
        With its first camera.
    count
        How many more: kinds follow each other as in :data:`RIGS`, from ``rig`` on.
    rig
        Kind of the first of them.
    rng
        Draws their places and lenses.
    own
        What each has of its own.
    """
    first = RIGS.index(rig)
    found = {kind: _further(robot, kind, rng) for kind in (RIGS[(first + k) % len(RIGS)] for k in range(count))}
    if not own.image_sizes:
        return found
    return {k: with_images_of(r, size) for (k, r), size in zip(found.items(), own.image_sizes[1:], strict=True)}


def _further(robot: Robot, kind: str, rng: np.random.Generator) -> Robot:
    own = robot.camera
    if kind == "rear":
        ahead = robot.T_body_cam[:2, 2]
        back = atan2(-ahead[1], -ahead[0]) + radians(rng.uniform(-8, 8))
        z = rng.uniform(0.1, 0.25)
        place = mount(
            yaw=back,
            pitch=atan2(z - 0.1, 0.6),
            x=0.05 * np.cos(back),
            y=0.05 * np.sin(back) + rng.uniform(-0.01, 0.01),
            z=z,
        )
        return with_camera_at(robot, place, replace(own, fu=0.9 * own.fu, fv=0.902 * own.fv))
    T_first_other = np.eye(4)
    T_first_other[0, 3] = BASELINE if kind == "stereo" else -_BESIDE
    if kind == "stereo":
        T_first_other[1:3, 3] = rng.normal(0, 5e-4, 2)
        place = robot.T_body_cam @ T_first_other
        return with_camera_at(robot, place, replace(own, fu=1.01 * own.fu, fv=1.01 * own.fv, kr=own.kr - 0.01))
    return with_camera(with_camera_at(robot, robot.T_body_cam @ T_first_other), CameraKind.FISHEYE, rng)


def stops_for_all(robots: Sequence[Robot], target: Target, options: DriveOptions, rng: np.random.Generator) -> Array:
    """Return stops (P, 3), x, y (m) and heading (rad), that show the box to one camera after the other.

    Errors as of :func:`boxcal.calib.simulate.viewpoints.choose_stops`.
    """
    gap = options.clearance + max(robot.reach for robot in robots)
    stops = np.empty((options.stops, 3))
    for k, robot in enumerate(robots):
        stops[k :: len(robots)] = choose_stops(robot, target, len(stops[k :: len(robots)]), gap, rng)
    return stops


def views_of(
    drive: Drive, robot: Robot, others: dict[str, Robot], record: RecordOptions, own: OwnSettings
) -> tuple[View, ...]:
    """Return a drive as each further camera sees and stamps it; no two have one clock, or one rate of images."""
    return tuple(
        View(
            robot=other,
            drive=seen_by(drive, robot, other),
            options=replace(own.of(number, record), topic=f"/{name}/image_raw", frame=f"{name}_optical_frame"),
        )
        for number, (name, other) in enumerate(others.items(), 1)
    )
