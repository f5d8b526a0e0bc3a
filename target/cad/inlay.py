"""Two-colour prints: the tags as black inlays in white walls, as 3MF for printers with two filaments."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.cad.build import Build, build_for, check_build
from boxcal.target.cad.numbers import T_box_lid_number, bars, lid_number_height
from boxcal.target.cad.panels import Panel, panels
from boxcal.target.cad.tags import tag_loops
from boxcal.target.cad.threemf import Coloured, threemf
from boxcal.target.files.target_json import target_sha256

if TYPE_CHECKING:
    import manifold3d

BED = 0.256
"""Side of the printer's bed, m."""
CLIP = 20e-6
"""Cut from black corners that meet diagonally, m: far below what a nozzle lays, but it keeps the solids closed."""
WHITE, BLACK = "#FFFFFF", "#000000"
_MM = 1e3


def box_3mf(target: Target, build: Build | None = None, *, bed: float = inf) -> bytes:
    """Return the open box, upright on its base, with the tags of all faces inlaid by one line width.

    Raises
    ------
    TargetError
        If the box cannot be built from these dimensions.
    """
    box, build = target.box, build or build_for(target.box)
    check_build(box, build)
    x, y, t, h = box.width / 2, box.depth / 2, build.wall, box.height
    walls = _block((-x, -y, 0), (x, y, h)) - _block((t - x, t - y, t), (x - t, y - t, 2 * h))
    for sx in (-1, 1):
        for sy in (-1, 1):
            walls += _tab(sx * (x - t), sy * (y - t), h - t, build.tab)
    ink = _sum([_inlay(target, face, build.line).transform(_rows(box.T_box_face(face))) for face in range(FACES)])
    return _file(target, "landmark box", walls, ink, bed=bed)


def panels_3mf(target: Target, build: Build | None = None, *, bed: float = inf) -> Mapping[str, bytes]:
    """Return the six panels with finger joints, outside down, tags and numbers inlaid by one layer: name -> content."""
    build = build or build_for(target.box)
    check_build(target.box, build)
    return {f"panel-{panel.name}.3mf": _panel(target, panel, build, bed) for panel in panels(target.box, build)}


def prints(target: Target, *, bed: float = BED) -> Mapping[str, bytes]:
    """Return ``box.3mf`` and ``panel-*.3mf`` for a bed, m; a note in their place if they are too large for it."""
    box = target.box
    files: dict[str, bytes] = {}
    if max(box.width, box.depth, box.height) <= bed:
        files = {"box.3mf": box_3mf(target, bed=bed), **panels_3mf(target, bed=bed)}
    if not files:
        size = " x ".join(f"{length * _MM:g}" for length in (box.width, box.depth, box.height))
        files["too-large.txt"] = (
            f"A box of {size} mm: neither it nor its panels fit a bed of {bed * _MM:g} mm.\n"
            "Have the panels cut (cut/panels.dxf), or glue printed sheets on boards.\n"
        ).encode()
    return files


def _panel(target: Target, panel: Panel, build: Build, bed: float) -> bytes:
    import manifold3d as m3  # noqa: PLC0415 - extra

    board = m3.CrossSection([panel.outline * _MM], m3.FillRule.EvenOdd).extrude(build.wall * _MM)
    board = board.translate((0, 0, -build.wall * _MM))
    ink = None
    if panel.face is not None:
        ink = _inlay(target, panel.face, build.layer)
    elif panel.name == "lid":
        ink = _sum([_number(target, face, build.layer) for face in range(FACES)])
    # Turned about y: the outside comes to lie on the bed.
    over = np.diag([-1.0, 1.0, -1.0, 1.0])
    return _file(target, panel.name, board.transform(_rows(over)), ink and ink.transform(_rows(over)), bed=bed)


def _inlay(target: Target, face: int, depth: float) -> "manifold3d.Manifold":
    """Return the black parts of a face, frame ``face``, from its surface down to a depth; mm."""
    import manifold3d as m3  # noqa: PLC0415 - extra

    loops = [loop * _MM for loop in tag_loops(target, face, clip=CLIP)]
    black = m3.CrossSection(loops, m3.FillRule.EvenOdd)
    w, h = target.box.face_width(face) * _MM, target.box.height * _MM
    black ^= m3.CrossSection.square((w, h), center=True)
    return black.extrude(depth * _MM).translate((0, 0, -depth * _MM))


def _number(target: Target, face: int, depth: float) -> "manifold3d.Manifold":
    """Return a face's number on the lid, frame of the lid's panel, mm."""
    import manifold3d as m3  # noqa: PLC0415 - extra

    parts = [
        m3.CrossSection.square(tuple((high - low) * _MM)).translate(tuple(low * _MM))
        for low, high in bars(face, lid_number_height(target.box))
    ]
    shape = m3.CrossSection.batch_boolean(parts, m3.OpType.Add)
    T = T_box_lid_number(target.box, face)
    T[2, 3] = -depth
    return shape.extrude(depth * _MM).transform(_rows(T))


def _file(
    target: Target, name: str, board: "manifold3d.Manifold", ink: "manifold3d.Manifold | None", *, bed: float
) -> bytes:
    title = f"Landmark box, target {target_sha256(target)[:12]}, {name}"
    bodies = [_coloured("white", WHITE, board if ink is None else board - ink)]
    if ink is not None:
        bodies.append(_coloured("black", BLACK, ink))
    low, high = np.array(board.bounding_box()).reshape(2, 3)
    middle = bed * _MM / 2 if np.isfinite(bed) else float((high - low)[:2].max() / 2)
    return threemf(name, bodies, title=title, middle_mm=middle)


def _coloured(name: str, colour: str, body: "manifold3d.Manifold") -> Coloured:
    mesh = body.to_mesh64()
    return Coloured(
        name=name, colour=colour, vertices=np.asarray(mesh.vert_properties)[:, :3], triangles=np.asarray(mesh.tri_verts)
    )


def _block(low: Sequence[float], high: Sequence[float]) -> "manifold3d.Manifold":
    import manifold3d as m3  # noqa: PLC0415 - extra

    size = tuple((b - a) * _MM for a, b in zip(low, high, strict=True))
    return m3.Manifold.cube(size).translate(tuple(a * _MM for a in low))


def _tab(x: float, y: float, z: float, leg: float) -> "manifold3d.Manifold":
    import manifold3d as m3  # noqa: PLC0415 - extra

    points = np.array([(x, y, z), (x - np.sign(x) * leg, y, z), (x, y - np.sign(y) * leg, z), (x, y, z - leg)])
    return m3.Manifold.hull_points(points * _MM)


def _sum(parts: "Sequence[manifold3d.Manifold]") -> "manifold3d.Manifold":
    import manifold3d as m3  # noqa: PLC0415 - extra

    return m3.Manifold.batch_boolean(list(parts), m3.OpType.Add)


def _rows(T: Array) -> Array:
    """Return a pose (4, 4) m as the (3, 4) mm matrix that manifold3d takes."""
    rows = T[:3].copy()
    rows[:, 3] *= _MM
    return np.asarray(rows)
