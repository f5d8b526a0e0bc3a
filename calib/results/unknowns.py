"""The unknowns beyond the 14 reported parameters: what their names mean, and the units that people read them in."""

import re
from dataclasses import dataclass
from math import pi


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """An unknown in words.

    Attributes
    ----------
    words
        What it is.
    unit
        That people read it in; empty for a pure number.
    scale
        Of that unit in one of calibration.json's (m, rad, s, 1).
    """

    words: str
    unit: str
    scale: float


_MM, _DEG, _PERCENT = ("mm", 1e3), ("°", 180 / pi), ("%", 100.0)
_FACE_MOVES = {
    "tx": ("to the right", _MM),
    "ty": ("up", _MM),
    "tz": ("outward", _MM),
    "rx": ("turned about its horizontal", _DEG),
    "ry": ("turned about its vertical", _DEG),
    "rz": ("turned in its plane", _DEG),
}
_PATTERNS: tuple[tuple[str, str, tuple[str, float]], ...] = (
    (r"tilt_([xy])(?:_(\d+))?", "tilt of the floor about the box's {0}{drive}", _DEG),
    (r"scale_x", "print scale across", _PERCENT),
    (r"scale_y", "print scale up", _PERCENT),
    (r"width|depth", "{name} of the box less its design", _MM),
    (r"seat", "all sheets higher than designed", _MM),
    (r"ink", "dot gain of the print: edges of the black outward", _MM),
    (r"growth", "edges of the tags' black outward in the picture", ("px", 1.0)),
    (r"bow(\d)", "face {0} bowed outward", _MM),
    (r"camera_late(?:_(\d+))?", "stamps of the camera less those of the wheels{drive}", ("ms", 1e3)),
    (r"camera_clock_rate(?:_(\d+))?", "rate of the camera's clock against the wheels'{drive}", ("ppm", 1e6)),
    (r"camera_readout", "time from the first row to the last of the shutter", ("ms", 1e3)),
    (r"k\d|p\d", "distortion coefficient {name}", ("", 1.0)),
)


def describe(name: str) -> Unknown:
    """Return what the name of an unknown means; a name that is not known here stands for itself, in SI units."""
    face = re.fullmatch(r"face(\d)_(\w\w)", name)
    if face and face[2] in _FACE_MOVES:
        words, (unit, scale) = _FACE_MOVES[face[2]]
        return Unknown(words=f"face {face[1]} {words}", unit=unit, scale=scale)
    for pattern, words, (unit, scale) in _PATTERNS:
        found = re.fullmatch(pattern, name)
        if found:
            last = found[found.re.groups] if found.re.groups and "{drive}" in words else None
            drive = f", drive {last}" if last else ""
            return Unknown(words=words.format(*found.groups(), name=name, drive=drive), unit=unit, scale=scale)
    return Unknown(words=name.replace("_", " "), unit="", scale=1.0)
