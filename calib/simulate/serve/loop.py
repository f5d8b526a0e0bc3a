"""A robot's time: it passes as a clock's does, or faster; wheels and images are sent as it passes."""

import threading
import time

from boxcal.calib.simulate.serve.bridge import Bridge
from boxcal.calib.simulate.serve.moving_robot import MovingRobot

JOINT_S = 0.02
"""Time between two messages of the wheels."""
_MOST_BEHIND_S = 0.5
_LEAST_WAIT_S = 0.0005
"""Time that is left to the camera even then: it would wait for the robot's lock without end."""


class Loop:
    """Two threads: one moves the robot and sends its wheels, one takes its images.

    Parameters
    ----------
    moving, bridge
        Who moves, and where that is sent.
    speed
        Seconds of the robot's time in a second.
    pictures_a_second
        Images in a second of the robot's time, at most.
    """

    def __init__(self, moving: MovingRobot, bridge: Bridge, speed: float, pictures_a_second: float) -> None:
        self._moving, self._bridge, self._speed = moving, bridge, speed
        self._interval = 1 / (pictures_a_second * speed)
        self._stopped = threading.Event()
        self._threads = [
            threading.Thread(target=self._move, name="wheels", daemon=True),
            threading.Thread(target=self._look, name="camera", daemon=True),
        ]

    def start(self) -> None:
        """Let time pass."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Stop time."""
        self._stopped.set()
        for thread in self._threads:
            thread.join(5)

    def _move(self) -> None:
        due = time.monotonic()
        while not self._stopped.is_set():
            self._moving.advance(JOINT_S)
            self._bridge.tell_joints()
            due += JOINT_S / self._speed
            now = time.monotonic()
            if now - due > _MOST_BEHIND_S:
                due = now  # the machine is too slow: the robot's time is, too
            self._stopped.wait(max(due - now, _LEAST_WAIT_S))

    def _look(self) -> None:
        while not self._stopped.is_set():
            begun = time.monotonic()
            self._bridge.tell_picture()
            self._stopped.wait(max(self._interval - (time.monotonic() - begun), 0.001))
