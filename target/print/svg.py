"""Faces and net as SVG in millimetres, for drawing programs, plotters and laser cutters.

Layers (Inkscape's groups) ``cut``, ``fold``, ``tags`` and ``text``; one user unit is one millimetre.
"""

from collections.abc import Mapping, Sequence
from xml.sax.saxutils import escape

import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.files.target_json import design_sha256
from boxcal.target.print.ink import face_ids
from boxcal.target.print.net import make_net
from boxcal.target.tags.families import modules_per_side, tag_modules
from boxcal.target.tags.outline import black_outline

_MM = 1e3
_MARGIN = 5.0
"""White around what is drawn, mm."""
_TEXT = 3.0
"""Size of letters, mm."""


def svg_files(target: Target) -> Mapping[str, bytes]:
    """Return ``face-0.svg`` to ``face-3.svg`` and ``net.svg``: name -> content; as designed, whatever was measured."""
    faces = {f"face-{face}.svg": face_svg(target, face) for face in range(FACES)}
    return {**faces, "net.svg": net_svg(target)}


def face_svg(target: Target, face: int) -> bytes:
    """Return one face, seen from outside with z up: its outline to cut, its tags and its name."""
    w, h = target.box.face_width(face) * _MM, target.box.height * _MM
    outline = np.array([[-w, -h], [w, -h], [w, h], [-w, h]]) / 2
    layers = {
        "cut": [_path([outline], closed=True)],
        "tags": [_tags(target, face, np.zeros(2))],
        "text": [_text(f"Face {face}, {face_ids(target, face)}, this way up", (0.0, h / 2 - 1.5 * _TEXT))],
    }
    return _document(target, f"face {face}", layers, outline)


def net_svg(target: Target) -> bytes:
    """Return the fold-up net in one piece, with base and lid."""
    net = make_net(target.box)
    outline = np.array(net.cut) * _MM
    top = {part.face: part.corners[2][1] * _MM for part in net.faces}
    layers = {
        "cut": [_path([outline], closed=True)],
        "fold": [_path([np.array(fold) * _MM for fold in net.folds], closed=False, dash="3 2")],
        "tags": [_tags(target, part.face, np.array(part.centre) * _MM) for part in net.faces],
        "text": [
            _text(
                f"Face {part.face}, {face_ids(target, part.face)}, this way up",
                (part.centre[0] * _MM, top[part.face] - 1.5 * _TEXT),
            )
            for part in net.faces
        ],
    }
    return _document(target, "net", layers, outline)


def _tags(target: Target, face: int, centre: Array) -> str:
    """Return the black of a face's tags as one path, filled by the even-odd rule."""
    box = target.box
    module = box.tag_size / modules_per_side(box.dictionary)
    ids = target.tag_ids[target.tag_faces == face]
    loops = [
        np.array(loop) * (module * _MM, -module * _MM) + corners[0] * _MM + centre
        for tag, corners in zip(ids, box.grid_corners(), strict=True)
        for loop in black_outline(tag_modules(box.dictionary, int(tag)))
    ]
    data = " ".join(_data(loop, closed=True) for loop in loops)
    return f'<path d="{data}" fill="#000000" fill-rule="evenodd" stroke="none"/>'


def _path(lines: Sequence[Array], *, closed: bool, dash: str = "") -> str:
    data = " ".join(_data(line, closed=closed) for line in lines)
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<path d="{data}" fill="none" stroke="#000000" stroke-width="0.1"{dashes}/>'


def _data(points: Array, *, closed: bool) -> str:
    """Return a line as path data; y runs down in SVG."""
    return "M" + " L".join(f"{x + 0.0:.6g},{0.0 - y:.6g}" for x, y in points) + (" Z" if closed else "")


def _text(text: str, at: tuple[float, float]) -> str:
    where = f'x="{at[0]:.6g}" y="{0.0 - at[1]:.6g}"'
    return f'<text {where} font-size="{_TEXT:g}" font-family="sans-serif" text-anchor="middle">{escape(text)}</text>'


def _document(target: Target, what: str, layers: Mapping[str, Sequence[str]], outline: Array) -> bytes:
    left, bottom = outline.min(axis=0) - _MARGIN
    width, height = np.ptp(outline, axis=0) + 2 * _MARGIN
    groups = [
        f'<g id="{name}" inkscape:groupmode="layer" inkscape:label="{name}">{"".join(items)}</g>'
        for name, items in layers.items()
    ]
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
            f'width="{width:.6g}mm" height="{height:.6g}mm" '
            f'viewBox="{left:.6g} {-(bottom + height):.6g} {width:.6g} {height:.6g}">',
            f"<title>Landmark box, target {design_sha256(target)[:8]}, {escape(what)}</title>",
            *groups,
            "</svg>\n",
        ]
    ).encode()
