"""Panels and net as DXF in millimetres, layers CUT, FOLD, ENGRAVE and NUMBER, for laser cutters and plotters."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.cad.build import Build, build_for, check_build
from boxcal.target.cad.numbers import T_box_lid_number, face_number, lid_number_height, strokes
from boxcal.target.cad.panels import panels, widened
from boxcal.target.cad.tags import tag_loops
from boxcal.target.print.net import make_net

if TYPE_CHECKING:
    from ezdxf.document import Drawing

LAYERS = {"CUT": 1, "FOLD": 5, "ENGRAVE": 7, "NUMBER": 3}
"""Layers and their colours by AutoCAD's index: red, blue, black, green. Tags are areas, numbers lines."""
_BETWEEN = 0.010
_MM = 1e3


@contextmanager
def _undated() -> Iterator[None]:
    """Have drawings made without the time of day, so that the same target gives the same bytes."""
    options = import_module("ezdxf").options
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


@_undated()
def panels_dxf(target: Target, build: Build | None = None, *, kerf: float = 0.0) -> bytes:
    """Return the six panels side by side, seen from outside, with tags and numbers to engrave.

    Parameters
    ----------
    target
        The box; tags lie where its corners say.
    build
        Dimensions; those that suit the box if none are given. ``wall`` must be the board's thickness.
    kerf : m
        What the laser burns away; outlines are widened by half of it. Most cutting software does so itself.
    """
    box, build = target.box, build or build_for(target.box)
    check_build(box, build)
    document = _document()
    x, rows = 0.0, (("face0", "face1", "face2", "face3"), ("base", "lid"))
    found = {panel.name: panel for panel in panels(box, build)}
    tall = max(box.height, box.depth)
    for row, names in enumerate(rows):
        x = 0.0
        for name in names:
            panel = found[name]
            width, height = np.ptp(panel.outline, axis=0)
            middle = np.array([x + width / 2, -row * (tall + _BETWEEN) + height / 2])
            x += width + _BETWEEN
            _line(document, "CUT", widened(panel.outline, kerf / 2) + middle, closed=True)
            if panel.face is not None:
                _face(document, target, panel.face, middle)
            if name == "lid":
                _lid_numbers(document, target, middle)
    return _bytes(document)


@_undated()
def net_dxf(target: Target) -> bytes:
    """Return the fold-up net of a box of thin card (:mod:`boxcal.target.print.net`).

    With tags and numbers to engrave or plot.
    """
    document = _document()
    plan = make_net(target.box)
    _line(document, "CUT", np.array(plan.cut), closed=True)
    for fold in plan.folds:
        _line(document, "FOLD", np.array(fold), closed=False)
    for part in plan.faces:
        _face(document, target, part.face, np.array(part.centre))
    return _bytes(document)


def _face(document: "Drawing", target: Target, face: int, middle: Array) -> None:
    for loop in tag_loops(target, face):
        _line(document, "ENGRAVE", loop + middle, closed=True)
    number = face_number(target.box, face)
    if number is not None:
        place, height = number
        for line in strokes(face, height):
            _line(document, "NUMBER", line + place + middle, closed=False)


def _lid_numbers(document: "Drawing", target: Target, middle: Array) -> None:
    for face in range(FACES):
        T = T_box_lid_number(target.box, face)
        for line in strokes(face, lid_number_height(target.box)):
            _line(document, "NUMBER", line @ T[:2, :2].T + T[:2, 3] + middle, closed=False)


def _document() -> "Drawing":
    from ezdxf import units  # noqa: PLC0415 - extra
    from ezdxf.document import Drawing  # noqa: PLC0415 - extra

    document = Drawing.new("R2010")
    document.units = units.MM
    for name, colour in LAYERS.items():
        document.layers.add(name, color=colour)
    return document


def _line(document: "Drawing", layer: str, points: Array, *, closed: bool) -> None:
    places = [(round(float(x) * _MM, 6), round(float(y) * _MM, 6)) for x, y in points]
    document.modelspace().add_lwpolyline(places, close=closed, dxfattribs={"layer": layer})


def _bytes(document: "Drawing") -> bytes:
    """Return the file, with the extents that programs zoom to and place it by."""
    from ezdxf import bbox  # noqa: PLC0415 - extra

    extents = bbox.extents(document.modelspace(), fast=True)
    document.header["$EXTMIN"], document.header["$EXTMAX"] = tuple(extents.extmin), tuple(extents.extmax)
    document.modelspace().dxf_layout.dxf.extmin, document.modelspace().dxf_layout.dxf.extmax = (
        extents.extmin,
        extents.extmax,
    )
    text = io.StringIO()
    document.write(text)
    return text.getvalue().encode()
