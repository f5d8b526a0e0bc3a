"""The camera's height against that of the robot's description: what alone can show a box that stands on something.

A box on a table moves the camera's height and nothing else, which no drive shows. Static transforms in the log say how
high the camera is in the robot's base frame. A footprint frame lies on the floor (REP 120); where a base link lies is
up to each robot, between the floor and the top of the wheels. Turns and the rest of the place are not compared: camera
frames look forward or along the optical axis, and base frames lie anywhere between the wheels.
"""

import numpy as np

from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.log.source import Source

CLOSE_M = 0.02
"""Descriptions are drawn to a centimetre or two: plates and brackets differ from robot to robot."""


def unlike_described(height: float, radius: float, source: Source) -> Finding | None:
    """Return what is said of a camera that is not as high as described; None if it is, or the log does not say.

    Parameters
    ----------
    height : m
        Of the camera above the floor that the box stands on.
    radius : m
        Of the wheels.
    source
        Where the drive comes from, with the camera's pose in the base frame.
    """
    if not source.nominal_T_base_cam:
        return None
    lowest = float(np.reshape(source.nominal_T_base_cam, (4, 4))[2, 3])
    on_floor = "footprint" in source.base_frame.rsplit("/", 1)[-1]
    highest = lowest if on_floor else lowest + 2 * radius
    off = height - lowest if height < lowest else max(height - highest, 0.0)
    if abs(off) <= CLOSE_M:
        return None
    described = f"{1e3 * lowest:.0f} mm" if on_floor else f"{1e3 * lowest:.0f} to {1e3 * highest:.0f} mm"
    frame = f"{source.base_frame} is on the floor" if on_floor else f"{source.base_frame} is not above the wheels"
    why = "the box stands on something" if off < 0 else "the robot stands higher than the box, or it is another box"
    return Finding(
        cause="box-raised" if off < 0 else "camera-height",
        text=f"the camera is {1e3 * height:.0f} mm above the floor that the box stands on, where the robot's "
        f"description in the log has it at {described} ({frame}): {why}, or the description is not of this robot",
        advice="Stand the box on the floor that the robot drives on; where it does, correct the description. Only the "
        "camera's height depends on it.",
        size=1e3 * abs(off),
        unit="mm",
    )
