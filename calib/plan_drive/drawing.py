"""The drawing of a plan from above: box, floor, stops with their arrows and order, and the paths between."""

from math import ceil, cos, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from boxcal.calib.plan_drive.instructions import corner_places
from boxcal.calib.planning.plan import DrivePlan
from boxcal.target.arrays import Array

if TYPE_CHECKING:
    from reportlab.graphics.shapes import Drawing, Group, Rect

PICTURE = "plan.svg"
_FONT = _BOLD = "Helvetica"
_ROOM = 0.25
"""Free floor around what is drawn, m."""
_DISC = 9.0
_STEP = 0.05
_GRID = 0.5


def plan_drawing(plan: DrivePlan, width: float, height: float) -> "Drawing":
    """Return the drawing, of a width and height in points, x out of face 0 to the right."""
    from reportlab.graphics.shapes import Drawing, Group  # noqa: PLC0415 - a command's --help must not wait for it

    low, high = _extent(plan)
    scale = min(width / (high[0] - low[0]), height / (high[1] - low[1]))
    middle = (low + high) / 2
    drawing, group = Drawing(width, height), Group()
    group.transform = (1, 0, 0, 1, width / 2 - scale * middle[0], height / 2 - scale * middle[1])
    _floor(group, plan, scale, (low, high))
    _ways(group, plan, scale)
    _box(group, plan, scale)
    for number, stop in enumerate(plan.stops, 1):
        _stop(group, scale * stop.pose[:2], float(stop.pose[2]), str(number))
    drawing.add(group)
    return drawing


def picture_bytes(plan: DrivePlan, side: float = 640.0) -> bytes:
    """Return the drawing as SVG."""
    from reportlab.graphics import renderSVG  # noqa: PLC0415

    low, high = _extent(plan)
    shape = (high - low) / max(high - low)
    text = renderSVG.drawToString(plan_drawing(plan, side * shape[0], side * shape[1]))
    return (text if isinstance(text, str) else text.decode()).encode()


def _extent(plan: DrivePlan) -> tuple[Array, Array]:
    """Return the corners of what is drawn, m: paths and box, and obstacles near them."""
    box = plan.target.box
    points = np.concatenate([*path_points(plan), plan.poses[:, :2], [[box.width / 2, box.depth / 2]]])
    points = np.concatenate([points, [[-box.width / 2, -box.depth / 2]]])
    return points.min(axis=0) - _ROOM, points.max(axis=0) + _ROOM


def path_points(plan: DrivePlan) -> list[Array]:
    """Return the points (N, 2), m, of the path to each stop after the first."""
    out = []
    for before, stop in zip(plan.stops[:-1], plan.stops[1:], strict=True):
        x, y, heading = (float(v) for v in before.pose)
        points = [(x, y)]
        for distance, turn in zip(stop.distance, stop.turn, strict=True):
            steps = max(ceil(abs(distance) / _STEP), 1) if distance else 1
            for _ in range(steps):
                middle = heading + turn / steps / 2
                chord = distance / steps * float(np.sinc(turn / steps / 2 / pi))
                x, y, heading = x + chord * cos(middle), y + chord * sin(middle), heading + turn / steps
                points.append((x, y))
        out.append(np.array(points))
    return out


def _rectangle(*corner_and_size: float, **style: object) -> "Rect":
    """Return a rectangle; reportlab's stubs do not know how it takes its style."""
    from reportlab.graphics.shapes import Rect  # noqa: PLC0415

    make: Any = Rect
    made: Rect = make(*corner_and_size, **style)
    return made


def _floor(group: "Group", plan: DrivePlan, scale: float, extent: tuple[Array, Array]) -> None:
    from reportlab.graphics.shapes import Line, String  # noqa: PLC0415
    from reportlab.lib.colors import HexColor  # noqa: PLC0415

    low, high = extent
    grey = HexColor("#e4e4e4")
    for axis in (0, 1):
        for line in np.arange(ceil(low[axis] / _GRID), np.floor(high[axis] / _GRID) + 1) * _GRID:
            ends = [low * scale, high * scale]
            ends[0][axis] = ends[1][axis] = line * scale
            group.add(Line(*ends[0], *ends[1], strokeColor=grey, strokeWidth=0.5))
    text = f"grid {_GRID:g} m"
    group.add(
        String(low[0] * scale + 3, low[1] * scale + 3, text, fontName=_FONT, fontSize=8, fillColor=HexColor("#777777"))
    )
    for x0, y0, x1, y1 in plan.options.floor.obstacles:
        left, bottom = max(x0, low[0]), max(y0, low[1])
        right, top = min(x1, high[0]), min(y1, high[1])
        if left < right and bottom < top:
            group.add(
                _rectangle(
                    left * scale,
                    bottom * scale,
                    (right - left) * scale,
                    (top - bottom) * scale,
                    fillColor=HexColor("#c9b8a8"),
                    strokeColor=None,
                )
            )


def _ways(group: "Group", plan: DrivePlan, scale: float) -> None:
    from reportlab.graphics.shapes import PolyLine  # noqa: PLC0415
    from reportlab.lib.colors import HexColor  # noqa: PLC0415

    for points in path_points(plan):
        group.add(
            PolyLine(
                (points * scale).ravel().tolist(),
                strokeColor=HexColor("#4477aa"),
                strokeWidth=1.2,
                strokeDashArray=(4, 3),
            )
        )


def _box(group: "Group", plan: DrivePlan, scale: float) -> None:
    from reportlab.graphics.shapes import String  # noqa: PLC0415
    from reportlab.lib.colors import HexColor, black  # noqa: PLC0415

    box = plan.target.box
    w, d = box.width * scale, box.depth * scale
    group.add(_rectangle(-w / 2, -d / 2, w, d, fillColor=HexColor("#f5e6c8"), strokeColor=black, strokeWidth=1))
    for name, (x, y) in corner_places(box).items():
        sx, sy = np.sign(x), np.sign(y)
        group.add(
            String(x * scale + 7 * sx, y * scale + 7 * sy - 3, name, fontName=_BOLD, fontSize=9, textAnchor="middle")
        )
    for face, (x, y) in enumerate(((w / 2 - 8, 0.0), (0.0, d / 2 - 9), (-w / 2 + 8, 0.0), (0.0, -d / 2 + 9))):
        group.add(String(x, y - 3, str(face), fontName=_FONT, fontSize=9, textAnchor="middle"))


def _stop(group: "Group", at: Array, heading: float, number: str) -> None:
    from reportlab.graphics.shapes import Circle, Polygon, String  # noqa: PLC0415
    from reportlab.lib.colors import HexColor, white  # noqa: PLC0415

    colour = HexColor("#aa3322")
    ahead, left = np.array([cos(heading), sin(heading)]), np.array([-sin(heading), cos(heading)])
    tip = at + 2.1 * _DISC * ahead
    corners = [tip, at + 0.8 * _DISC * left, at - 0.8 * _DISC * left]
    group.add(Polygon(np.concatenate(corners).tolist(), fillColor=colour, strokeColor=None))
    group.add(Circle(float(at[0]), float(at[1]), _DISC, fillColor=colour, strokeColor=white, strokeWidth=1))
    group.add(
        String(
            float(at[0]), float(at[1]) - 3.5, number, fontName=_BOLD, fontSize=10, fillColor=white, textAnchor="middle"
        )
    )
