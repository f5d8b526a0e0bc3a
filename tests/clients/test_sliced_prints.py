"""The two-colour prints, sliced by PrusaSlicer itself (Debian: ``apt-get install prusa-slicer``)."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from boxcal.target.arrays import Array
from boxcal.target.box import Box, Target, make_target
from boxcal.target.cad.tags import tag_loops

cadquery = pytest.importorskip("manifold3d", reason="the extra cad is not installed")
SLICER = shutil.which("prusa-slicer")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(SLICER is None, reason="prusa-slicer is not installed (apt-get install prusa-slicer)"),
]
SMALL = Box(width=0.12, depth=0.12, height=0.12, columns=3, rows=3)
BED, LAYER, NOZZLE = 250.0, 0.2, 0.4
"""Bed's side, layer and nozzle, mm."""


def sliced(content: bytes, folder: Path) -> dict[int, Array]:
    """Extruding moves of each tool: (N, 5) x, y, to x, to y, z, mm."""
    (folder / "print.3mf").write_bytes(content)
    words = ["--nozzle-diameter", f"{NOZZLE},{NOZZLE}", "--filament-diameter", "1.75,1.75", "--temperature", "210,210"]
    words += ["--layer-height", str(LAYER), "--first-layer-height", str(LAYER), "--skirts", "0", "--dont-arrange"]
    words += ["--bed-shape", f"0x0,{BED:g}x0,{BED:g}x{BED:g},0x{BED:g}", "--export-gcode", "-o", "print.gcode"]
    subprocess.run([str(SLICER), *words, "print.3mf"], cwd=folder, check=True, capture_output=True, timeout=240)
    tool, place, moves = 0, {"X": 0.0, "Y": 0.0, "Z": 0.0}, {0: [], 1: []}
    for line in (folder / "print.gcode").read_text().splitlines():
        code = line.split(";")[0].strip()
        if re.fullmatch(r"T\d", code):
            tool = int(code[1])
        elif code.startswith(("G0 ", "G1 ")):
            given = {axis: float(value) for axis, value in re.findall(r"([XYZE])(-?[\d.]+)", code)}
            before = dict(place)
            place.update({axis: value for axis, value in given.items() if axis in place})
            if given.get("E", 0) > 0 and {"X", "Y"} & set(given):
                moves[tool].append((before["X"], before["Y"], place["X"], place["Y"], place["Z"]))
    return {number: np.array(rows) for number, rows in moves.items()}


def inked(target: Target, face: int, moves: Array) -> Array:
    """Whether the middles of moves lie on ink; the panel lies face down about the bed's middle."""
    middle = (moves[:, :2] + moves[:, 2:4]) / 2 - BED / 2
    p_face = middle * (-1, 1) / 1e3
    crossings = np.zeros(len(middle), dtype=int)
    for loop in tag_loops(target, face):
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            spans = (a[1] > p_face[:, 1]) != (b[1] > p_face[:, 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                at = a[0] + (p_face[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            crossings += spans & (p_face[:, 0] < at)
    return crossings % 2 == 1


def test_tags_are_printed_by_tool_1_and_nothing_else_is(tmp_path: Path) -> None:
    from boxcal.target.cad.inlay import panels_3mf  # noqa: PLC0415 - extra

    target = make_target(SMALL)
    moves = sliced(panels_3mf(target, bed=BED / 1e3)["panel-face1.3mf"], tmp_path)
    black, white = moves[1], moves[0]
    assert np.unique(black[:, 4]) == pytest.approx([LAYER]), "the inlay is the first layer"
    assert inked(target, 1, black).mean() > 0.995
    first = white[white[:, 4] <= LAYER + 1e-6]
    assert inked(target, 1, first).mean() < 0.005
    # all of the ink is there: the area that tool 1 lays is that of the tags, a nozzle's width a move
    length = np.linalg.norm(black[:, 2:4] - black[:, :2], axis=1).sum()
    area = abs(sum(signed_area(loop) for loop in tag_loops(target, 1))) * 1e6
    assert length * NOZZLE == pytest.approx(area, rel=0.25)
    low, high = np.minimum(white[:, :2], white[:, 2:4]).min(axis=0), np.maximum(white[:, :2], white[:, 2:4]).max(axis=0)
    assert (low + high) / 2 == pytest.approx([BED / 2] * 2, abs=0.1)


def signed_area(loop: Array) -> float:
    x, y = loop.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)
