"""The timeline of a recording as an image: how the wheels ran, where the robot stood, what it saw there."""

from typing import TYPE_CHECKING, Any

import numpy as np

from boxcal.calib.check_log.check import LogCheck
from boxcal.calib.check_log.recorded import gaps
from boxcal.calib.check_log.stops import tags_a_face
from boxcal.target.arrays import Array

if TYPE_CHECKING:
    from reportlab.graphics.shapes import Drawing

_WIDTH, _LEFT, _RIGHT = 1000.0, 70.0, 15.0
_TOP, _SPEED, _ROW = 26.0, 110.0, 18.0
_COLOURS = ("#4477aa", "#ee8866", "#44aa77", "#aa4488")
_POINTS = 900


def timeline_bytes(check: LogCheck) -> bytes:
    """Return the timeline of a checked recording as SVG."""
    from reportlab.graphics import renderSVG  # noqa: PLC0415 - a command's --help must not wait for it

    text = renderSVG.drawToString(timeline(check))
    return (text if isinstance(text, str) else text.decode()).encode()


def timeline(check: LogCheck) -> "Drawing":
    """Return the drawing: speed of both wheels, stands and stops, images, gaps, tags of each face at each stop."""
    from reportlab.graphics.shapes import Drawing  # noqa: PLC0415

    height = _TOP + _SPEED + 7 * _ROW
    drawing = Drawing(_WIDTH, height)
    _text(drawing, 10, height - 16, check.name[:80], size=12)
    if check.wheels is None or len(check.wheels) < 2:
        _text(drawing, _LEFT, height / 2, "nothing could be read", size=11)
        return drawing
    t0, t1 = int(check.wheels.t_ns[0]), int(check.wheels.t_ns[-1])
    scale = (_WIDTH - _LEFT - _RIGHT) / max(t1 - t0, 1)

    def x(t_ns: Array | int) -> Any:
        return _LEFT + (np.asarray(t_ns, dtype=np.float64) - t0) * scale

    base = height - _TOP - _SPEED
    _stands(drawing, check, x, (base, _SPEED))
    _speeds(drawing, check, x, base)
    _images(drawing, check, x, base - 1.5 * _ROW)
    _faces(drawing, check, x, base - 2 * _ROW)
    _axis(drawing, x, (t0, t1), 12.0)
    return drawing


def _stands(drawing: "Drawing", check: LogCheck, x: Any, rows: tuple[float, float]) -> None:
    seen = {} if check.drive is None else {s.t_start_ns: k for k, s in enumerate(check.drive.stops)}
    for stand in check.stands:
        left, right = float(x(stand.t_start_ns)), float(x(stand.t_end_ns))
        known = stand.t_start_ns in seen
        _bar(drawing, left, rows[0], max(right - left, 1.0), rows[1], "#dfe9dc" if known else "#f3dcd6")
        if known:
            _text(drawing, (left + right) / 2 - 4, rows[0] + rows[1] - 11, str(seen[stand.t_start_ns] + 1), size=9)
    if check.wheels is not None:
        for begin, end in gaps(check.wheels.t_ns):
            _bar(drawing, float(x(begin)), rows[0], float(x(end) - x(begin)), rows[1], "#cc3311")


def _speeds(drawing: "Drawing", check: LogCheck, x: Any, base: float) -> None:
    from reportlab.graphics.shapes import PolyLine  # noqa: PLC0415
    from reportlab.lib.colors import HexColor  # noqa: PLC0415

    wheels = check.wheels
    if wheels is None:
        return
    every = max(1, len(wheels) // _POINTS)
    t, seconds = wheels.t_ns[::every], np.diff(wheels.t_ns[::every]) / 1e9
    speeds = [np.diff(phi[::every]) / seconds for phi in (wheels.phi_R, wheels.phi_L)]
    most = max(float(np.max(np.abs(np.concatenate(speeds)))), 1e-9)
    middle = x((t[:-1] + t[1:]) // 2)
    for speed, colour in zip(speeds, ("#aa3322", "#2255aa"), strict=True):
        y = base + _SPEED / 2 + speed / most * (_SPEED / 2 - 12)
        drawing.add(
            PolyLine(np.stack([middle, y], axis=1).ravel().tolist(), strokeColor=HexColor(colour), strokeWidth=0.8)
        )
    _text(drawing, 8, base + _SPEED / 2 + 6, "right", size=9, colour="#aa3322")
    _text(drawing, 8, base + _SPEED / 2 - 8, "left wheel", size=9, colour="#2255aa")


def _images(drawing: "Drawing", check: LogCheck, x: Any, y: float) -> None:
    _text(drawing, 8, y + 3, "images", size=9)
    for left in x(check.frame_t_ns[:: max(1, len(check.frame_t_ns) // _POINTS)]):
        _bar(drawing, float(left), y, 0.7, 10.0, "#777777")


def _faces(drawing: "Drawing", check: LogCheck, x: Any, top: float) -> None:
    if check.drive is None:
        return
    for face, row in enumerate(tags_a_face(check.drive).T):
        y = top - (face + 1) * _ROW * 0.9
        _text(drawing, 8, y + 3, f"face {face}", size=9)
        for stop, tags in zip(check.drive.stops, row, strict=True):
            left = float(x(stop.t_start_ns))
            _bar(drawing, left, y, max(float(x(stop.t_end_ns)) - left, 3.0), 13.0 * min(tags / 35, 1.0), _COLOURS[face])


def _axis(drawing: "Drawing", x: Any, span: tuple[int, int], y: float) -> None:
    seconds = (span[1] - span[0]) / 1e9
    step = next((s for s in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if seconds / s <= 12), 5000)
    for second in range(0, int(seconds) + 1, step):
        at = float(x(span[0] + second * 1_000_000_000))
        _bar(drawing, at, y, 0.6, 6.0, "#333333")
        _text(drawing, at - 8, y - 10, f"{second} s", size=8)


def _bar(drawing: "Drawing", left: float, bottom: float, width: float, height: float, colour: str) -> None:  # noqa: PLR0917
    from reportlab.graphics.shapes import Rect  # noqa: PLC0415
    from reportlab.lib.colors import HexColor  # noqa: PLC0415

    make: Any = Rect
    drawing.add(make(left, bottom, width, height, fillColor=HexColor(colour), strokeColor=None))


def _text(drawing: "Drawing", x: float, y: float, text: str, *, size: float, colour: str = "#000000") -> None:
    from reportlab.graphics.shapes import String  # noqa: PLC0415
    from reportlab.lib.colors import HexColor  # noqa: PLC0415

    make: Any = String
    drawing.add(make(x, y, text, fontName="Helvetica", fontSize=size, fillColor=HexColor(colour)))
