"""The box as a parametric solid: body with corner tabs, lid, pin, and its panels; STEP and STL in millimetres."""

import re
import tempfile
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.cad.build import Build, build_for, check_build, pin_places
from boxcal.target.cad.numbers import T_box_lid_number, bars, face_number, lid_number_height
from boxcal.target.cad.panels import panels
from boxcal.target.files.target_json import target_sha256

if TYPE_CHECKING:
    import cadquery

_MM = 1e3
_PROUD = 0.001
"""How far cutting tools stand out of what they cut, m."""
_FINGER_HOLE = 0.020
_PIN_GRIP = 0.004
_STL_TOLERANCE_MM, _STL_ANGLE = 0.005, 0.2
_DATE = rb"(FILE_NAME\('[^']*',\s*')[^']*'"
_USAGE = rb"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\(')\d+'"
"""What Open CASCADE writes anew each time: the time of day, and a count over the life of the process."""


def box_step(target: Target, build: Build | None = None) -> bytes:
    """Return the box as one STEP file of two solids, body and lid, in place: frame ``box``, millimetres.

    The outside is that of the box's dimensions; sheets are glued on it. Where the tags leave room, each
    wall has the number of its face engraved below them, and holes for pins at the sheet's corners (see
    :func:`boxcal.target.cad.build.pin_places`); the lid carries the four numbers beside their faces.
    """
    build = build or build_for(target.box)
    return _step(target, {"body": _body(target, build), "lid": _lid(target, build)})


def panels_step(target: Target, build: Build | None = None) -> bytes:
    """Return the six panels with finger joints as one STEP file, put together: frame ``box``, millimetres."""
    build = build or build_for(target.box)
    check_build(target.box, build)
    parts = {}
    for panel in panels(target.box, build):
        parts[panel.name] = _extruded(panel.outline, build.wall).located(_location(panel.T_box_panel))
    return _step(target, parts)


def box_stls(target: Target, build: Build | None = None) -> dict[str, bytes]:
    """Return body, lid and pin as STL files to print, millimetres: file name -> content.

    The body stands as in frame ``box``; the lid lies on its underside and the pin stands, both about the origin.
    """
    from cadquery import Solid, Vector  # noqa: PLC0415 - extra

    build = build or build_for(target.box)
    lid = _lid(target, build).translate(Vector(0, 0, -(target.box.height - build.wall) * _MM))
    length = build.wall - build.pin_floor + _PIN_GRIP
    pin = Solid.makeCylinder(build.pin / 2 * _MM, length * _MM)
    return {f"{name}.stl": _stl(part) for name, part in (("body", _body(target, build)), ("lid", lid), ("pin", pin))}


def _body(target: Target, build: Build) -> "cadquery.Shape":
    """Return walls, base and corner tabs, less pin holes and numbers."""
    box = target.box
    check_build(box, build)
    x, y, t = box.width / 2, box.depth / 2, build.wall
    shell = _block((-x, -y, 0), (x, y, box.height)).cut(_block((t - x, t - y, t), (x - t, y - t, box.height + _PROUD)))
    tabs = [_tab(sx * (x - t), sy * (y - t), box.height - t, build.tab) for sx in (-1, 1) for sy in (-1, 1)]
    tools: list[cadquery.Shape] = []
    for face in range(FACES):
        T = box.T_box_face(face)
        number = face_number(box, face)
        if number is not None:
            tools += _engraved(face, number[1], T @ _shift(number[0]), build.engraving)
        tools += [_hole(T @ _shift(pin), build) for pin in pin_places(box, build, face)]
    body = shell.fuse(*tabs)
    return (body.cut(*tools) if tools else body).clean()


def _lid(target: Target, build: Build) -> "cadquery.Shape":
    """Return the lid in place: flush with the rim, with a hole to lift it by."""
    from cadquery import Solid, Vector  # noqa: PLC0415 - extra

    box = target.box
    check_build(box, build)
    x, y = (length / 2 - build.wall - build.lid_gap for length in (box.width, box.depth))
    low = box.height - build.wall
    plate = _block((-x, -y, low), (x, y, box.height))
    radius = min(_FINGER_HOLE / 2, min(x, y) / 4)
    hole = Solid.makeCylinder(radius * _MM, 3 * build.wall * _MM, Vector(0, 0, (low - build.wall) * _MM))
    tools: list[cadquery.Shape] = [hole]
    for face in range(FACES):
        tools += _engraved(face, lid_number_height(box), T_box_lid_number(box, face), build.engraving)
    return plate.cut(*tools).clean()


def _block(low: tuple[float, float, float], high: tuple[float, float, float]) -> "cadquery.Solid":
    from cadquery import Solid, Vector  # noqa: PLC0415 - extra

    dx, dy, dz = ((b - a) * _MM for a, b in zip(low, high, strict=True))
    return Solid.makeBox(dx, dy, dz, Vector(*(a * _MM for a in low)))


def _tab(x: float, y: float, z: float, leg: float) -> "cadquery.Shape":
    """Return a corner tab: level on top, running out into the corner below, so that it prints without support."""
    from cadquery import Face, Shell, Solid, Vector, Wire  # noqa: PLC0415 - extra

    points = [(x, y, z), (x - np.sign(x) * leg, y, z), (x, y - np.sign(y) * leg, z), (x, y, z - leg)]
    a, b, c, d = (Vector(*(float(v) * _MM for v in point)) for point in points)
    sides = [
        Face.makeFromWires(Wire.makePolygon(list(side), close=True))
        for side in ((a, b, c), (a, b, d), (a, c, d), (b, c, d))
    ]
    return Solid.makeSolid(Shell.makeShell(sides)).fix()


def _engraved(digit: int, height: float, T_box_digit: Array, depth: float) -> list["cadquery.Shape"]:
    """Return the tools that engrave a digit into the plane z = 0 of its frame."""
    where = _location(T_box_digit)
    return [_block((*low, -depth), (*high, _PROUD)).located(where) for low, high in bars(digit, height)]


def _hole(T_box_pin: Array, build: Build) -> "cadquery.Shape":
    from cadquery import Solid, Vector  # noqa: PLC0415 - extra

    depth, radius = build.wall - build.pin_floor, (build.pin + build.pin_play) / 2
    drill = Solid.makeCylinder(radius * _MM, (depth + _PROUD) * _MM, Vector(0, 0, -depth * _MM))
    return drill.located(_location(T_box_pin))


def _extruded(outline: Array, wall: float) -> "cadquery.Shape":
    from cadquery import Solid, Vector, Wire  # noqa: PLC0415 - extra

    wire = Wire.makePolygon([Vector(float(x) * _MM, float(y) * _MM, 0) for x, y in outline], close=True)
    return Solid.extrudeLinear(wire, [], Vector(0, 0, -wall * _MM))


def _shift(xy: Array) -> Array:
    T = np.eye(4)
    T[:2, 3] = xy
    return T


def _location(T: Array) -> "cadquery.Location":
    from cadquery import Location, Plane, Vector  # noqa: PLC0415 - extra

    origin, x, z = (Vector(*(float(v) for v in column)) for column in (T[:3, 3] * _MM, T[:3, 0], T[:3, 2]))
    return Location(Plane(origin, x, z))


def _step(target: Target, parts: Mapping[str, "cadquery.Shape"]) -> bytes:
    from cadquery import Assembly  # noqa: PLC0415 - extra

    whole = Assembly(name=f"landmark_box_{target_sha256(target)[:12]}")
    for name, part in parts.items():
        whole.add(part, name=name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.step"
        whole.export(str(path))
        content = path.read_bytes()
    content = re.sub(_DATE, rb"\g<1>1970-01-01T00:00:00'", content, count=1)
    numbers = count(1)
    return re.sub(_USAGE, lambda found: found[1] + b"%d'" % next(numbers), content)


def _stl(part: "cadquery.Shape") -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.stl"
        part.exportStl(str(path), tolerance=_STL_TOLERANCE_MM, angularTolerance=_STL_ANGLE, ascii=False)
        return path.read_bytes()
