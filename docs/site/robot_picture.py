"""The tutorial's drawing of a robot: what is calibrated on it, from the side and from above."""

import numpy as np

from boxcal.calib.simulate.robot import Robot

PX_PER_M = 900
"""Scale of the drawing."""
_INK, _BLUE, _ORANGE, _SOFT = "#222", "#06c", "#e90", "#777"


def robot_svg(robot: Robot) -> str:
    """Return a drawing of a robot as SVG: wheels, wheel separation, the camera's place, the frame on the floor."""
    side, above = _side(robot), _above(robot)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 760 330" width="760" height="330" '
        'font-family="sans-serif" font-size="13">\n'
        "<title>What is calibrated: both radii, the wheel separation, where the camera sits and looks</title>\n"
        '<rect width="760" height="330" fill="#fff"/>\n'
        f'<g transform="translate(110 270)">{side}</g>\n<g transform="translate(560 150)">{above}</g>\n</svg>\n'
    )


def _line(x1: float, y1: float, x2: float, y2: float, colour: str = _INK) -> str:
    return f'<path d="M{x1:.0f} {y1:.0f}L{x2:.0f} {y2:.0f}" stroke="{colour}" stroke-width="1.5"/>'


def _text(x: float, y: float, words: str, colour: str = _INK, anchor: str = "middle") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" fill="{colour}" text-anchor="{anchor}">{words}</text>'


def _side(robot: Robot) -> str:
    """From the side, its front to the right; origin below the axle."""
    s, r, (x, _, z) = PX_PER_M, (robot.rR + robot.rL) / 2, robot.T_body_cam[:3, 3]
    forward = robot.T_body_cam[:3, 2]
    pitch, half = np.arctan2(-forward[2], forward[0]), np.arctan2(robot.image_size[1] / 2, robot.camera.fv)
    low, high = pitch + half, pitch - half
    floor = x + z / np.tan(low)  # where the lower edge of the picture meets the floor
    far = 0.31
    upper, lower = (z - (far - x) * np.tan(angle) for angle in (high, low))
    rays = f"M{x * s:.0f} {-z * s:.0f}L{far * s:.0f} {-lower * s:.0f}V{-upper * s:.0f}Z"
    return "".join(
        (
            f'<path d="{rays}" fill="{_ORANGE}" fill-opacity="0.22"/>',
            _line(-95, 0, 300, 0, _SOFT),
            f'<rect x="-72" y="{-z * s + 8:.0f}" width="{(x + 0.08) * s:.0f}" height="{z * s - 30:.0f}" rx="8" '
            f'fill="#eee" stroke="{_INK}"/>',
            f'<circle cx="0" cy="{-r * s:.0f}" r="{r * s:.0f}" fill="#ccc" stroke="{_INK}" stroke-width="1.5"/>',
            _line(0, -r * s, 0, 0, _BLUE) + _text(5, -r * s / 2 + 4, "r", _BLUE, "start"),
            f'<circle cx="{x * s:.0f}" cy="{-z * s:.0f}" r="7" fill="{_ORANGE}" stroke="{_INK}"/>',
            _text(x * s, -z * s - 14, "camera", _INK),
            _line(0, 0, 46, 0, "#c33") + _text(52, 18, "x, base frame on the floor", "#c33", "start"),
            _line(0, 0, 0, -46, "#36c"),
            _text(100, 45, f"from the side: it sees the floor from {floor:.1f} m on", _SOFT),
        )
    )


def _above(robot: Robot) -> str:
    """From above, its front to the right; origin between the wheels."""
    s, half, r = PX_PER_M, robot.b / 2, robot.rR
    x, y = robot.T_body_cam[:2, 3]
    yaw = np.arctan2(robot.T_body_cam[1, 2], robot.T_body_cam[0, 2])
    wide = np.arctan2(robot.image_size[0] / 2, robot.camera.fu)
    ends = [(x + 0.15 * np.cos(yaw + d), y + 0.15 * np.sin(yaw + d)) for d in (-wide, wide)]
    view = " ".join(f"{px * s:.0f},{-py * s:.0f}" for px, py in ((x, y), *ends))
    wheels = "".join(
        f'<rect x="{-r * s:.0f}" y="{-side * half * s - 8:.0f}" width="{2 * r * s:.0f}" height="16" fill="#ccc" '
        f'stroke="{_INK}" stroke-width="1.5"/>{_text(-r * s - 8, -side * half * s + 5, name, _INK, "end")}'
        for side, name in ((1, "left, rL"), (-1, "right, rR"))
    )
    return "".join(
        (
            f'<circle cx="-8" cy="0" r="{half * s - 4:.0f}" fill="#eee" stroke="{_INK}"/>',
            f'<polygon points="{view}" fill="{_ORANGE}" fill-opacity="0.3"/>',
            wheels,
            _line(0, -half * s, 0, half * s, _BLUE) + _text(-6, 30, "b", _BLUE, "end"),
            _line(0, 0, 46, 0, "#c33") + _text(42, 17, "x", "#c33"),
            _line(0, 0, 0, -46, "#2a2") + _text(11, -40, "y", "#2a2"),
            f'<circle cx="{x * s:.0f}" cy="{-y * s:.0f}" r="7" fill="{_ORANGE}" stroke="{_INK}"/>',
            _text(0, 165, "from above", _SOFT),
        )
    )
