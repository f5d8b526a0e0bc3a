"""Pictures of the tutorial, rendered: ``make pictures`` writes them to docs/pictures."""

import sys
from math import radians
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from robot_picture import robot_svg  # beside this file

import boxcal
from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.simulate.robot import turtlebot
from boxcal.calib.simulate.simulated_drive import SimulatedDrive
from boxcal.target.render.pictures import box_pictures
from boxcal.target.render.renderer import render
from boxcal.target.render.sensor import SensorModel

OUT = Path(__file__).resolve().parents[1] / "pictures"
PX_PER_M = 220
"""Scale of the floor plan."""
GOOD = SensorModel(noise=1.5, psf_px=0.6, srgb=True)
FRAMES = (
    ("good: two faces, fills half the image", 0.55, GOOD),
    ("too far: tags under 10 px", 2.6, GOOD),
    ("out of focus", 0.55, SensorModel(noise=1.5, psf_px=5.0, srgb=True)),
    ("overexposed", 0.55, SensorModel(noise=1.5, psf_px=0.6, srgb=True, gain=4.0)),
)
"""Caption, distance from the box's face (m) and sensor of each example."""


def main() -> int:
    """Write the tutorial's pictures; returns the exit status."""
    OUT.mkdir(exist_ok=True)
    name, picture = next(iter(box_pictures(boxcal.make_target()).items()))
    (OUT / f"tutorial-box{Path(name).suffix}").write_bytes(picture)
    (OUT / "tutorial-plan.svg").write_text(_plan(boxcal.simulate(stops=12, seed=1)))
    (OUT / "tutorial-robot.svg").write_text(robot_svg(turtlebot()))
    frames = [_frame(caption, distance, sensor) for caption, distance, sensor in FRAMES]
    sheet = np.vstack([np.hstack(frames[:2]), np.hstack(frames[2:])])
    cv2.imwrite(str(OUT / "tutorial-frames.png"), sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 0


def _frame(caption: str, distance: float, sensor: SensorModel) -> NDArray[np.uint8]:
    """Return what a robot sees that stands before a corner of the box, in half the size, with its caption."""
    robot, target = turtlebot(), boxcal.make_target()
    away, azimuth = target.box.width / 2 + distance, radians(35)
    pose = (away * np.cos(azimuth), away * np.sin(azimuth), azimuth + np.pi + radians(-2))
    T_cam_box = inverse(planar(*pose) @ robot.T_body_cam)
    image = render(target, robot.camera, T_cam_box, robot.image_size, sensor, np.random.default_rng(0))
    small = cv2.resize(image, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
    bar = np.full((26, small.shape[1]), 255, dtype=np.uint8)
    cv2.putText(bar, caption, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, 0, 1, cv2.LINE_AA)
    framed = cv2.copyMakeBorder(np.vstack([bar, small]), 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255.0,))
    return np.asarray(framed, dtype=np.uint8)


def _plan(simulated: SimulatedDrive) -> str:
    """Return the floor plan of a drive as SVG: box, path and stops with the directions that the camera looks in."""
    path, stops, box = simulated.drive.path[::200, :2], simulated.drive.stop_poses, simulated.target.box
    low, high = path.min(axis=0) - 0.25, path.max(axis=0) + 0.25
    width, height = (high - low) * PX_PER_M

    def at(x: float, y: float) -> str:
        """Return a point of the floor in the picture's axes."""
        return f"{(x - low[0]) * PX_PER_M:.1f},{(high[1] - y) * PX_PER_M:.1f}"

    half = (box.width / 2, box.depth / 2)
    corners = " ".join(at(sx * half[0], sy * half[1]) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1)))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" '
        f'height="{height:.0f}" font-family="sans-serif" font-size="13">',
        f"<title>A drive around the box with {len(stops)} stops</title>",
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
        f'<polyline points="{" ".join(at(x, y) for x, y in path)}" fill="none" stroke="#8ab" stroke-width="1.5"/>',
        f'<polygon points="{corners}" fill="#333"/>',
        f'<text x="{at(0, 0).partition(",")[0]}" y="{at(0, 0).partition(",")[2]}" fill="#fff" text-anchor="middle" '
        'dominant-baseline="middle">box</text>',
    ]
    for number, (x, y, heading) in enumerate(stops, 1):
        yaw = heading + _camera_yaw(simulated)
        cx, cy = at(x, y).split(",")
        ends = [at(x + 0.22 * np.cos(yaw + d), y + 0.22 * np.sin(yaw + d)) for d in (-0.35, 0.35)]
        parts.append(f'<polygon points="{cx},{cy} {ends[0]} {ends[1]}" fill="#e90" fill-opacity="0.35"/>')
        parts.append(f'<circle cx="{cx}" cy="{cy}" r="9" fill="#06c"/>')
        parts.append(
            f'<text x="{cx}" y="{cy}" fill="#fff" text-anchor="middle" dominant-baseline="central" font-size="11">'
            f"{number}</text>"
        )
    return "\n".join([*parts, "</svg>"]) + "\n"


def _camera_yaw(simulated: SimulatedDrive) -> float:
    """Return the yaw of the robot's camera, rad."""
    x, y = simulated.robot.T_body_cam[:2, 2]
    return float(np.arctan2(y, x))


if __name__ == "__main__":
    sys.exit(main())
