"""The simulated robot drives as it is told, reads what its wheels did, and cannot be driven into the box."""

import json
import threading
from collections.abc import Iterator
from http.client import HTTPConnection

import numpy as np
import pytest
from live_messages import Followed, until

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.local_page.board import Board
from boxcal.calib.simulate.kinematics import arc_path
from boxcal.calib.simulate.robot import turtlebot
from boxcal.calib.simulate.serve.bridge import Bridge
from boxcal.calib.simulate.serve.camera import LiveCamera, usual_sensor
from boxcal.calib.simulate.serve.loop import Loop
from boxcal.calib.simulate.serve.moving_robot import PATIENCE_S, MovingRobot
from boxcal.calib.simulate.serve.page import DrivePage
from boxcal.detect.log.images import decode_frame
from boxcal.target.box import make_target

TARGET = make_target()
START = np.array([-0.9, -0.5, 0.4])


def _robot(slip: float = 0.0, step: float = 0.0) -> MovingRobot:
    return MovingRobot(turtlebot(), TARGET, START, slip, step, 0.3, np.random.default_rng(1))


def _arrived(moving: MovingRobot) -> None:
    for _ in range(4000):
        if not moving.moving:
            return
        moving.advance(0.05)
    raise AssertionError("it never arrives")


def test_it_goes_where_it_is_sent_round_the_box() -> None:
    moving = _robot()
    before = moving.readings
    moving.go_to(0.8, 0.6, 3.0, whole_turns=-1)
    assert len(moving.ahead) > 5
    _arrived(moving)
    x, y, heading = moving.pose
    assert (x, y) == pytest.approx((0.8, 0.6), abs=1e-9)
    assert np.cos(heading - 3.0) == pytest.approx(1, abs=1e-12)
    travel = (moving.readings - before) * (moving.robot.rR, moving.robot.rL)
    assert (travel[0] - travel[1]) / moving.robot.b == pytest.approx(heading - START[2], abs=1e-9)
    assert abs(heading - START[2]) > 2 * np.pi - 3.2, "the whole turn was made"


def test_its_wheels_tell_its_way() -> None:
    moving = _robot()
    readings, poses = [moving.readings], [moving.pose]
    for v, w in ((0.2, 0.0), (0.1, 0.8), (-0.1, 0.3)):
        for _ in range(40):
            moving.drive(v, w)
            moving.advance(0.0025)
            readings.append(moving.readings)
            poses.append(moving.pose)
    roll = np.diff(readings, axis=0) * (moving.robot.rR, moving.robot.rL)
    path = arc_path(poses[0], roll.mean(axis=1), (roll[:, 0] - roll[:, 1]) / moving.robot.b)
    assert np.allclose(path, poses, atol=1e-9)


def test_speeds_that_are_not_asked_for_again_end() -> None:
    moving = _robot()
    moving.drive(0.2, 0.0)
    moving.advance(PATIENCE_S)
    assert moving.moving
    moving.advance(1.0)
    assert not moving.moving


def test_it_cannot_be_driven_into_the_box() -> None:
    moving = _robot()
    moving.go_to(-0.6, 0.0, 0.0)
    _arrived(moving)
    for _ in range(200):
        moving.drive(0.3, 0.0)
        moving.advance(0.05)
    assert -0.5 < moving.pose[0] < -0.2
    for x, y in ((0.0, 0.0), (0.13, 0.1), (100.0, 0.0), (float("nan"), 0.0)):
        with pytest.raises(CalibError):
            moving.go_to(x, y, 0.0)


def test_readings_are_rounded_down_to_the_encoders_steps() -> None:
    moving = _robot(step=0.01)
    moving.go_to(-0.9, 0.3, 0.0)
    _arrived(moving)
    assert np.allclose(moving.readings / 0.01, np.rint(moving.readings / 0.01), atol=1e-9)


def test_a_pushed_box_changes_what_the_camera_sees_not_where_the_robot_is() -> None:
    moving = _robot()
    pose, before = moving.pose, moving.T_box_cam
    moving.move_box(0.02, -0.01, 0.05)
    assert np.array_equal(moving.pose, pose)
    assert np.allclose(moving.T_box_cam, inverse(planar(0.02, -0.01, 0.05)) @ before)


def test_a_standing_camera_has_new_noise_in_every_picture_and_lights_can_go_out() -> None:
    moving = _robot()
    camera = LiveCamera(moving, usual_sensor(), np.random.default_rng(2))
    first, second = camera.picture().astype(float), camera.picture().astype(float)
    assert np.std(first - second) / np.sqrt(2) == pytest.approx(1.5, rel=0.1)
    assert np.mean(first - second) == pytest.approx(0, abs=0.02)
    camera.set_gain(0.02)
    assert np.mean(camera.picture()) < 0.5 * np.mean(first)


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[int, int]]:
    """Ports of a robot's page and of its topics."""
    moving = _robot()
    camera = LiveCamera(moving, usual_sensor(), np.random.default_rng(2))
    bridge, board, stopped = Bridge(moving, camera, "127.0.0.1", 0), Board(), threading.Event()
    page = DrivePage(moving, camera, f"ws://127.0.0.1:{bridge.port}", "")
    server = page.server(board, stopped, "127.0.0.1", 0)
    server.start()
    loop = Loop(moving, bridge, speed=2.0, pictures_a_second=5.0)
    loop.start()
    board.put(page.state())
    yield server.port, bridge.port
    stopped.set()
    loop.stop()
    bridge.stop()
    server.stop()


def _post(port: int, path: str, content: object) -> tuple[int, str]:
    connection = HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("POST", path, json.dumps(content), {"X-Boxcal": "page"})
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text


def test_its_topics_are_those_of_a_foxglove_bridge(served: tuple[int, int]) -> None:
    with Followed(f"ws://127.0.0.1:{served[1]}") as link:
        came: list[object] = []
        until(lambda: came.extend(link.inbox.take(0.05)) or {m.picture for m in came} == {True, False})  # type: ignore[attr-defined]
        image = next(m for m in came if m.picture)  # type: ignore[attr-defined]
        assert decode_frame(image.channel, image.data).shape == (480, 640)  # type: ignore[attr-defined, union-attr]


def test_its_page_drives_it_and_refuses_nonsense(served: tuple[int, int]) -> None:
    port = served[0]
    assert _post(port, "/go", {"x": -0.85, "y": -0.5}) == (200, '{"said":""}')
    assert _post(port, "/drive", {"v": 0.1, "w": 0})[0] == 200
    assert _post(port, "/go", {"x": 0, "y": 0})[0] == 409
    for path, content in (
        ("/go", {"x": "a", "y": 1}),
        ("/drive", {"v": 1}),
        ("/drive", {"v": float("inf"), "w": 0}),
        ("/trouble", {"kind": "x"}),
        ("/go", [1]),
    ):
        assert _post(port, path, content)[0] == 400, path
    assert _post(port, "/go", {"x": "1" * 5000})[0] == 413
    for kind in ("box", "slip", "dark", "dark"):
        assert _post(port, "/trouble", {"kind": kind})[0] == 200
