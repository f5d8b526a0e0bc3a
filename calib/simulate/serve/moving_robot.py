"""A robot that is driven while it is simulated, by speeds or to a place; its wheels slip as in simulated drives."""

import threading
from math import floor, pi

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.simulate.kinematics import MAX_ACCELERATION, Arc, arc_path, slipped, wheel_turns
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.route import KeepOut, route
from boxcal.target.arrays import Array
from boxcal.target.box import Target

STEP_S = 0.0025
"""Time in which the wheels' speeds stay the same."""
PATIENCE_S = 0.7
"""A speed that is not asked for again ends so soon: the page that asked may be gone."""
FARTHEST_M = 20.0
_CLEARANCE_M = 0.06
_MOST_WHOLE_TURNS = 5


class MovingRobot:
    """The true state of a robot that is being driven.

    Parameters
    ----------
    robot, target
        Who drives around what.
    start : (3,), m and rad
        Where it stands first.
    slip : m/sqrt(m)
        Slip of each wheel.
    encoder_step : rad
        The readings are rounded down to a multiple of it.
    max_speed : m/s
        Of a wheel's rim.
    rng
        Draws the slip and the wheels' first angles.
    """

    def __init__(  # noqa: PLR0917  who, where, and how
        self,
        robot: Robot,
        target: Target,
        start: Array,
        slip: float,
        encoder_step: float,
        max_speed: float,
        rng: np.random.Generator,
    ) -> None:
        self.robot, self.target = robot, target
        self._keep_out = KeepOut.around(target.box, _CLEARANCE_M + robot.reach)
        self._slip, self._step, self._max_speed, self._rng = slip, encoder_step, max_speed, rng
        self._lock = threading.Lock()
        self._pose = np.array(start, dtype=np.float64)
        self._phi = rng.uniform(-15, 15, 2)
        self._planned = np.zeros((0, 2))
        self._wanted, self._expires = np.zeros(2), 0
        self._rim = np.zeros(2)
        self._steps = 0
        self._T_floor_box = np.eye(4)

    @property
    def time_s(self) -> float:
        """Time since the beginning, s."""
        return self._steps * STEP_S

    @property
    def pose(self) -> Array:
        """True x, y (m) and heading (rad) on the floor, (3,); the box stood at its origin first."""
        with self._lock:
            return self._pose.copy()

    @property
    def readings(self) -> Array:
        """The encoders' angles, right and left, rad."""
        with self._lock:
            return self._phi.copy() if self._step == 0 else np.floor(self._phi / self._step) * self._step

    @property
    def moving(self) -> bool:
        """Whether it moves or is about to."""
        with self._lock:
            return bool(len(self._planned) or np.any(self._rim) or np.any(self._wanted))

    @property
    def ahead(self) -> Array:
        """The path that is planned: places (N, 2), m."""
        with self._lock:
            planned, pose = self._planned[::40], self._pose
        if not len(planned):
            return np.zeros((0, 2))
        rim = 40 * planned * (self.robot.rR, self.robot.rL)
        path = arc_path(pose, rim.mean(axis=1), (rim[:, 0] - rim[:, 1]) / self.robot.b)
        return np.asarray(path[:, :2])

    @property
    def T_box_cam(self) -> Array:
        """True pose of the camera in the box's frame, (4, 4), m."""
        with self._lock:
            return np.asarray(inverse(self._T_floor_box) @ planar(*self._pose) @ self.robot.T_body_cam)

    def drive(self, v: float, w: float) -> None:
        """Drive by speeds, m/s ahead and rad/s to the left, for a short while; a path that was planned is given up."""
        half = w * self.robot.b / 2
        wanted = np.clip(np.array([v + half, v - half]), -self._max_speed, self._max_speed)
        with self._lock:
            if len(self._planned):
                self._planned = np.zeros((0, 2))
            self._wanted, self._expires = wanted, self._steps + round(PATIENCE_S / STEP_S)

    def go_to(self, x: float, y: float, heading: float, whole_turns: int = 0) -> None:
        """Drive to a place (m, rad) by straights and turns on the spot that keep off the box.

        Raises
        ------
        CalibError
            If the place is in the box, too near to it, or too far away.
        """
        goal = np.array([x, y, heading])
        if not np.all(np.isfinite(goal)) or np.hypot(x, y) > FARTHEST_M or abs(whole_turns) > _MOST_WHOLE_TURNS:
            raise CalibError(f"no place to drive to within {FARTHEST_M:g} m of the box")
        if self._keep_out.off_box(goal[None, :2])[0] < self._keep_out.gap:
            raise CalibError("that place is too near the box")
        with self._lock:
            arcs = route(self._pose, goal, self._keep_out, None, exact_heading=False)
            arcs += [Arc(distance=0.0, turn=2 * pi * whole_turns)] * bool(whole_turns)
            r = self.robot
            turns = wheel_turns(arcs, rR=r.rR, rL=r.rL, b=r.b, max_speed=self._max_speed, step_s=STEP_S)
            self._planned = np.stack(turns, axis=1)
            self._wanted, self._rim = np.zeros(2), np.zeros(2)

    def advance(self, seconds: float) -> None:
        """Let time pass, a whole number of steps."""
        for _ in range(max(floor(seconds / STEP_S + 0.5), 0)):
            self._one_step()

    def move_box(self, x: float, y: float, turn: float) -> None:
        """Push the box (m, rad), as somebody's foot does."""
        with self._lock:
            self._T_floor_box = planar(x, y, turn) @ self._T_floor_box

    def slip_wheel(self, distance: float) -> None:
        """Let the right wheel roll over a distance, m, without moving the robot."""
        with self._lock:
            self._phi[0] += distance / self.robot.rR

    def _one_step(self) -> None:
        radius = np.array([self.robot.rR, self.robot.rL])
        with self._lock:
            self._steps += 1
            if len(self._planned):
                dphi, self._planned = self._planned[0], self._planned[1:]
                rim = radius * dphi
            else:
                if self._steps > self._expires:
                    self._wanted = np.zeros(2)
                most = MAX_ACCELERATION * STEP_S
                self._rim = self._rim + np.clip(self._wanted - self._rim, -most, most)
                rim = self._rim * STEP_S
                dphi = rim / radius
            if not np.any(rim):
                return
            travel = slipped(rim, self._slip, self._rng)
            new = arc_path(self._pose, travel.mean(keepdims=True), np.array([travel[0] - travel[1]]) / self.robot.b)[1]
            before, after = self._keep_out.off_box(np.array([self._pose[:2], new[:2]]))
            if after < self._keep_out.gap and after < before:
                self._rim = np.zeros(2)
                self._planned = np.zeros((0, 2))
                return
            self._pose, self._phi = new, self._phi + dphi
