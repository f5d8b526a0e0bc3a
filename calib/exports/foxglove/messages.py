"""Messages that Foxglove shows, as JSON, and the JSON schemas that tell it what they are.

Field names and meanings are those of Foxglove's message schemas (docs.foxglove.dev); pixel positions in annotations
count from the corner of the top-left pixel, half a pixel more than ours.
"""

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from boxcal.calib.geometry.euler import quaternion
from boxcal.target.arrays import Array

Message = dict[str, Any]
PIXEL_CORNER = 0.5
"""What is added to our pixel positions, px."""
STRIP, LOOP, LIST = 0, 1, 2
POINTS, LINE_LIST = 1, 4


def stamp(t_ns: int) -> Message:
    """Return a time."""
    return {"sec": int(t_ns) // 1_000_000_000, "nsec": int(t_ns) % 1_000_000_000}


def colour(rgb: Sequence[float] | Array, alpha: float = 1.0) -> Message:
    """Return a colour, parts from 0 to 1."""
    return {"r": float(rgb[0]), "g": float(rgb[1]), "b": float(rgb[2]), "a": alpha}


def vector(values: Sequence[float] | Array) -> Message:
    """Return a point or vector of two or three parts."""
    return dict(zip("xyz", (float(v) for v in values), strict=False))


def rotation(R: Array) -> Message:
    """Return a quaternion."""
    return dict(zip("xyzw", quaternion(R), strict=True))


def pose(T: Array) -> Message:
    """Return a pose."""
    return {"position": vector(T[:3, 3]), "orientation": rotation(T[:3, :3])}


def frame_transform(t_ns: int, parent: str, child: str, T: Array) -> Message:
    """Return ``T_parent_child``."""
    return {
        "timestamp": stamp(t_ns),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": vector(T[:3, 3]),
        "rotation": rotation(T[:3, :3]),
    }


def entity(t_ns: int, frame: str, name: str, **parts: list[Message]) -> Message:
    """Return a thing in the scene that stays; parts are lists of cubes, lines, arrows, texts."""
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": stamp(t_ns),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **{kind: parts.get(kind, []) for kind in kinds},
    }


def lines(points: Array, rgb: Sequence[float], kind: int, width_px: float = 2.0) -> Message:
    """Return lines through points (N, 3), m."""
    return {
        "type": kind,
        "pose": pose(np.eye(4)),
        "thickness": width_px,
        "scale_invariant": True,
        "points": [vector(p) for p in points],
        "color": colour(rgb),
        "colors": [],
        "indices": [],
    }


def text(at: Array, words: str) -> Message:
    """Return words that always face the viewer, at a place (3,), m."""
    T = np.eye(4)
    T[:3, 3] = at
    return {
        "pose": pose(T),
        "billboard": True,
        "font_size": 14.0,
        "scale_invariant": True,
        "color": colour((1, 1, 1)),
        "text": words,
    }


def compressed_image(t_ns: int, frame: str, jpeg: bytes) -> Message:
    """Return an image."""
    data = base64.b64encode(jpeg).decode()
    return {"timestamp": stamp(t_ns), "frame_id": frame, "data": data, "format": "jpeg"}


def points_annotation(t_ns: int, kind: int, uv_px: Array, colours: Array, thickness: float) -> Message:
    """Return points, or lines between pairs of them, on an image; uv_px (N, 2) in our pixel positions."""
    return {
        "timestamp": stamp(t_ns),
        "type": kind,
        "points": [vector(p) for p in uv_px + PIXEL_CORNER],
        "outline_color": colour((0, 1, 0)),
        "outline_colors": [colour(c) for c in colours],
        "fill_color": colour((0, 0, 0), 0.0),
        "thickness": thickness,
        "metadata": [],
    }


def text_annotation(t_ns: int, uv_px: Sequence[float], words: str) -> Message:
    """Return words on an image."""
    return {
        "timestamp": stamp(t_ns),
        "position": vector(np.asarray(uv_px, dtype=np.float64) + PIXEL_CORNER),
        "text": words,
        "font_size": 14.0,
        "text_color": colour((1, 1, 1)),
        "background_color": colour((0, 0, 0), 0.6),
        "metadata": [],
    }
