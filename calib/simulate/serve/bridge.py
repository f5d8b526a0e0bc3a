"""The topics of a simulated robot on a real Foxglove server, as foxglove_bridge would serve them."""

import logging
import time
from typing import Any

import foxglove
import numpy as np
from rosbags.typesys import Stores, get_typestore

from boxcal.calib.simulate.mcap_writer import JOINTS
from boxcal.calib.simulate.recorder import CAMERA_TOPIC, JOINT_TOPIC, LEFT_JOINT, RIGHT_JOINT
from boxcal.calib.simulate.serve.camera import LiveCamera
from boxcal.calib.simulate.serve.moving_robot import MovingRobot
from boxcal.target.render.renderer import encode_jpeg

_IMAGE = "sensor_msgs/msg/CompressedImage"
_NS = 1_000_000_000
_BACKLOG = 256
"""Messages that wait for a slow client; beyond them the oldest are dropped."""


class Bridge:
    """Serves joint states and images.

    Parameters
    ----------
    moving, camera
        Whose.
    host, port
        Where; port 0 takes any that is free.
    quality
        Of the images' JPEG.
    """

    def __init__(self, moving: MovingRobot, camera: LiveCamera, host: str, port: int, quality: int = 90) -> None:
        logging.getLogger("foxglove").setLevel(logging.CRITICAL)
        foxglove.set_log_level("CRITICAL")
        self._moving, self._camera, self._quality = moving, camera, quality
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._begun_ns = time.time_ns()
        self._context = context = foxglove.Context()  # its channels go with it
        self._joints = self._channel(JOINT_TOPIC, JOINTS, context)
        self._pictures = self._channel(f"{CAMERA_TOPIC}/compressed", _IMAGE, context)
        self._server = foxglove.start_server(
            name=f"simulated {moving.robot.name}", host=host, port=port, context=context, message_backlog_size=_BACKLOG
        )

    @property
    def port(self) -> int:
        """Port that it listens at."""
        return int(self._server.port)

    def stop(self) -> None:
        """Stop serving; clients are disconnected."""
        self._server.stop()
        self._joints.close()
        self._pictures.close()

    def tell_joints(self) -> None:
        """Send the wheels' angles as they are now."""
        t_ns, none = self._now_ns(), np.zeros(0)
        message = self._new(
            JOINTS,
            header=self._header(t_ns, ""),
            name=[RIGHT_JOINT, LEFT_JOINT],
            position=self._moving.readings,
            velocity=none,
            effort=none,
        )
        self._joints.log(bytes(self._store.serialize_cdr(message, JOINTS)), log_time=t_ns)

    def tell_picture(self) -> None:
        """Take an image and send it."""
        t_ns = self._now_ns()
        data = encode_jpeg(self._camera.picture(), self._quality)
        message = self._new(
            _IMAGE, header=self._header(t_ns, "camera"), format="jpeg", data=np.frombuffer(data, dtype=np.uint8)
        )
        self._pictures.log(bytes(self._store.serialize_cdr(message, _IMAGE)), log_time=self._now_ns())

    def _channel(self, topic: str, kind: str, context: "foxglove.Context") -> "foxglove.Channel":
        text = self._store.generate_msgdef(kind, ros_version=2)[0]
        schema = foxglove.Schema(name=kind, encoding="ros2msg", data=text.encode())
        return foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=context)

    def _now_ns(self) -> int:
        return self._begun_ns + round(self._moving.time_s * _NS)

    def _header(self, t_ns: int, frame_id: str) -> Any:
        sec, nanosec = divmod(t_ns, _NS)
        stamp = self._new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self._new("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)

    def _new(self, kind: str, **content: Any) -> Any:
        return self._store.types[kind](**content)
