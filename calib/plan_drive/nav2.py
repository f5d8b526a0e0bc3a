"""Waypoints for Nav2: the goal of its action ``follow_waypoints`` in the box's frame."""

from math import cos, pi, remainder, sin

import numpy as np

from boxcal.calib.planning.plan import DrivePlan, PlannedStop
from boxcal.target.arrays import Array

WAYPOINTS = "waypoints.yaml"
FRAME = "box"
_PART = 2 * pi / 3
"""A whole turn is given as waypoints so far apart, since a pose does not count turns."""
_HEADER = f"""\
# Stops of a planned drive, in the frame of the box: origin below its middle, x out of face 0, y out of face 1.
# Tell the map where the box stands (X Y in m, YAW in rad, of the box in the map):
#   ros2 run tf2_ros static_transform_publisher --x X --y Y --yaw YAW --frame-id map --child-frame-id {FRAME}
# Let the robot wait at each waypoint; parameters of waypoint_follower:
#   wait_at_waypoint: {{plugin: "nav2_waypoint_follower::WaitAtWaypoint", waypoint_pause_duration: 2500}}
# Then drive:
#   ros2 action send_goal /follow_waypoints nav2_msgs/action/FollowWaypoints "$(cat {WAYPOINTS})"
"""


def nav2_bytes(plan: DrivePlan) -> bytes:
    """Return the goal of Nav2's ``follow_waypoints`` as YAML: geometry_msgs/PoseStamped in frame ``box``."""
    lines = ["poses:"]
    for number, stop in enumerate(plan.stops, 1):
        for pose in waypoints(stop, plan.stops[number - 2] if number > 1 else None):
            last = np.array_equal(pose, stop.pose)
            lines += _pose(pose, f"stop {number}" if last else f"whole turn on the way to stop {number}")
    return (_HEADER + "\n".join(lines) + "\n").encode()


def waypoints(stop: PlannedStop, before: PlannedStop | None) -> list[Array]:
    """Return the poses (3,) to go to for a stop: the stop's own, and before it those that make it turn whole turns."""
    if before is None or not len(stop.turn):
        return [stop.pose]
    last = float(stop.turn[-1])
    if abs(last) <= pi + 1e-9:
        return [stop.pose]
    parts = int(np.ceil(abs(last) / _PART))
    return [stop.pose - np.array([0.0, 0.0, last * (1 - k / parts)]) for k in range(1, parts + 1)]


def _pose(pose: Array, comment: str) -> list[str]:
    x, y, heading = float(pose[0]), float(pose[1]), remainder(float(pose[2]), 2 * pi)
    return [
        f"  - header: {{frame_id: {FRAME}}}  # {comment}",
        "    pose:",
        f"      position: {{x: {x:.4f}, y: {y:.4f}, z: 0.0}}",
        f"      orientation: {{x: 0.0, y: 0.0, z: {sin(heading / 2):.6f}, w: {cos(heading / 2):.6f}}}",
    ]
