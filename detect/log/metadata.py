"""Metadata of a recording: robot description, static transforms, camera info, parameters of its nodes."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.urdf_wheels import urdf_wheels
from boxcal.detect.log.wheel_parameters import reckoned_by, says_of_wheels
from boxcal.target.arrays import Array

BASE_FRAMES = ("base_footprint", "base_link", "base", "chassis")
STRING, TRANSFORMS, CAMERA_INFO = "std_msgs/msg/String", "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/CameraInfo"
PARAMETERS = "rcl_interfaces/msg/ParameterEvent"
METADATA_TYPES = {STRING, TRANSFORMS, CAMERA_INFO, PARAMETERS}
MAX_DESCRIPTION_BYTES = 8 << 20
_MAX_TRANSFORMS, _MAX_TAKEN, _MAX_CAMERAS = 2000, 200, 50
_MAX_EVENTS, _MAX_PARAMETERS, _MAX_NODES = 10_000, 1000, 100
_INTEGER, _DOUBLE = 2, 3
"""Types of parameters (rcl_interfaces/msg/ParameterType)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transform:
    """A fixed transform: the pose of a child frame in its parent's, translation (m) and quaternion (x, y, z, w)."""

    parent: str
    child: str
    t: tuple[float, float, float]
    q: tuple[float, float, float, float]

    def matrix(self) -> Array:
        """Return the pose as a matrix, (4, 4), m; of a quaternion without length no rotation."""
        x, y, z, w = np.array(self.q) / (float(np.linalg.norm(self.q)) or 1.0)
        T = np.eye(4)
        T[:3, :3] += 2 * np.array(
            [
                [-y * y - z * z, x * y - z * w, x * z + y * w],
                [x * y + z * w, -x * x - z * z, y * z - x * w],
                [x * z - y * w, y * z + x * w, -x * x - y * y],
            ]
        )
        T[:3, 3] = self.t
        return T


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInfo:
    """Nominal camera parameters as a driver publishes them.

    Attributes
    ----------
    frame_id
        The camera's frame.
    size : px
        Width and height.
    model
        Distortion model, in ROS' words.
    k, d
        Camera matrix (9, row by row) and distortion coefficients.
    """

    frame_id: str
    size: tuple[int, int]
    model: str
    k: tuple[float, ...]
    d: tuple[float, ...]


@dataclass(slots=True, kw_only=True)
class Metadata:
    """Collects what a recording says of the robot.

    Attributes
    ----------
    description
        The robot's URDF, empty if it was not recorded.
    transforms
        Static transforms by child frame.
    cameras
        Camera parameters by topic.
    parameters
        What nodes' parameters say of wheels, by node and name: the last that the recording has.
    """

    description: str = ""
    transforms: dict[str, Transform] = field(default_factory=dict)
    cameras: dict[str, CameraInfo] = field(default_factory=dict)
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    _taken: int = 0
    _events: int = 0

    def wants(self, kind: str, topic: str) -> bool:
        """Return whether a message of a topic can say anything new."""
        if kind == STRING:
            return topic.endswith("robot_description") and not self.description
        if kind == TRANSFORMS:
            return topic.endswith("tf_static") and self._taken < _MAX_TAKEN
        if kind == PARAMETERS:
            return self._events < _MAX_EVENTS
        return topic not in self.cameras and len(self.cameras) < _MAX_CAMERAS

    def nominal_wheels(self) -> tuple[float, float] | None:
        """Return the wheel radius and separation, m, of the driver's parameters, else of the robot's description.

        None if neither says them.
        """
        found = reckoned_by(self.parameters.values())
        if found is not None or not self.description:
            return found
        try:
            return urdf_wheels(self.description.encode(), "/robot_description")
        except DetectError:  # a robot of other joints; whoever needs the values is told that they are not known
            return None

    def base_frame(self) -> str:
        """Return the robot's base frame by the usual names, empty if there is none of them."""
        names = {n for t in self.transforms.values() for n in (t.parent, t.child)}
        return next((n for n in BASE_FRAMES if n in names), "")

    def fixed_transform(self, parent: str, child: str) -> Array | None:
        """Return the pose of one frame in another, (4, 4), by static transforms; None if they do not join the two."""
        chains = []
        for start in (parent.lstrip("/"), child.lstrip("/")):
            frame, T, chain = start, np.eye(4), {start: np.eye(4)}
            while (found := self.transforms.get(frame)) is not None and found.parent not in chain:
                T = found.matrix() @ T
                frame = found.parent
                chain[frame] = T.copy()
            chains.append(chain)
        common = next((frame for frame in chains[0] if frame in chains[1]), None)
        if common is None or not parent or not child:
            return None
        return np.asarray(np.linalg.inv(chains[0][common]) @ chains[1][common])

    def take(self, kind: str, topic: str, message: Any) -> None:
        """Take a message (DetectError if it is not what its type says)."""
        self._taken += kind != PARAMETERS
        try:
            if kind == STRING:
                text = str(message.data)
                self.description = text if len(text) <= MAX_DESCRIPTION_BYTES else ""
            elif kind == TRANSFORMS:
                for found in message.transforms[:_MAX_TRANSFORMS]:
                    t, q = found.transform.translation, found.transform.rotation
                    child = str(found.child_frame_id)[:256].lstrip("/")
                    if len(self.transforms) < _MAX_TRANSFORMS:
                        self.transforms[child] = Transform(
                            parent=str(found.header.frame_id)[:256].lstrip("/"),
                            child=child,
                            t=(float(t.x), float(t.y), float(t.z)),
                            q=(float(q.x), float(q.y), float(q.z), float(q.w)),
                        )
            elif kind == PARAMETERS:
                self._take_parameters(message)
            else:
                self.cameras[topic] = CameraInfo(
                    frame_id=str(message.header.frame_id)[:256],
                    size=(int(message.width), int(message.height)),
                    model=str(message.distortion_model)[:64],
                    k=tuple(float(v) for v in getattr(message, "k", getattr(message, "K", ()))),
                    d=tuple(float(v) for v in tuple(getattr(message, "d", getattr(message, "D", ())))[:32]),
                )
        except (AttributeError, TypeError, ValueError) as error:
            raise DetectError(f"no {kind} ({error})") from error

    def _take_parameters(self, event: Any) -> None:
        """Take what a node's parameters were declared or set to, of those that say something of wheels."""
        self._events += 1
        node = str(event.node)[:256]
        for found in (*event.new_parameters[:_MAX_PARAMETERS], *event.changed_parameters[:_MAX_PARAMETERS]):
            name, kind = str(found.name)[:256], int(found.value.type)
            if kind in {_INTEGER, _DOUBLE} and says_of_wheels(name) and len(self.parameters) < _MAX_NODES:
                value = found.value.double_value if kind == _DOUBLE else found.value.integer_value
                self.parameters.setdefault(node, {})[name] = float(value)
