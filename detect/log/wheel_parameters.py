"""The wheels that a driver's parameters say it reckons with, in the names that public drivers give them.

Names: diff_drive_controller (``wheel_radius``, ``wheel_separation`` and their multipliers), turtlebot3_node
(``wheels.radius``, ``wheels.separation``), raspimouse2 and ROS 1 drivers (``wheel_diameter``, ``wheel_tread``,
``axle_length``, ``track_width``, ``base_width``).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite

from boxcal.detect.log.wheel_names import SIDES

_SIZES = {"radius": 1.0, "diameter": 0.5}
_RADII = {f"{wheel}{size}": factor for wheel in ("wheel", "wheels") for size, factor in _SIZES.items()}
_SEPARATIONS = {
    *("wheelseparation", "wheelsseparation", "wheeltread", "wheeltrack", "wheelstrack", "trackwidth"),
    *("axlelength", "basewidth"),
}
_MULTIPLIERS = {f"{of}multiplier" for of in ("wheelradius", "leftwheelradius", "rightwheelradius", "wheelseparation")}
_NAMES = {*_RADII, *_SEPARATIONS, *_MULTIPLIERS}
_LARGEST = 100.0
"""Wheels and separations below this, m, are believed."""
_SAME = 1e-9


def says_of_wheels(name: str) -> bool:
    """Return whether a parameter's name, such as ``wheels.radius``, can say something of a driver's wheels."""
    return _plain(name) in _NAMES


@dataclass(frozen=True, slots=True, kw_only=True)
class DriverWheels:
    """The wheels of a driver's parameters.

    Attributes
    ----------
    radius, separation : m
        As its parameters have them.
    right, left, apart
        Multipliers of the right radius, the left radius and the separation.
    """

    radius: float
    separation: float
    right: float = 1.0
    left: float = 1.0
    apart: float = 1.0

    @property
    def reckoned(self) -> tuple[float, float] | None:
        """Wheel radius and separation, m, that odometry is reckoned with; None if the wheels have two radii.

        With one radius such odometry cannot be taken apart.
        """
        found = (self.radius * self.right, self.separation * self.apart)
        sound = all(isfinite(v) and 0 < v < _LARGEST for v in found)
        return found if sound and abs(self.right - self.left) <= _SAME else None


def driver_wheels(parameters: Mapping[str, float]) -> DriverWheels | None:
    """Return the wheels that one node's parameters, by name, say; None if they do not give radius and separation."""
    values = {_plain(name): value for name, value in parameters.items()}
    radius = {values[name] * factor for name, factor in _RADII.items() if name in values}
    separation = {values[name] for name in _SEPARATIONS if name in values}
    if len(radius) != 1 or len(separation) != 1:
        return None
    both = values.get("wheelradiusmultiplier", 1.0)
    right, left = (both * values.get(f"{side}wheelradiusmultiplier", 1.0) for side in SIDES)
    return DriverWheels(
        radius=radius.pop(),
        separation=separation.pop(),
        right=right,
        left=left,
        apart=values.get("wheelseparationmultiplier", 1.0),
    )


def reckoned_by(nodes: Iterable[Mapping[str, float]]) -> tuple[float, float] | None:
    """Return the wheel radius and separation, m, that nodes reckon with; None if none gives them, or they differ."""
    given = {wheels.reckoned for wheels in map(driver_wheels, nodes) if wheels is not None}
    return given.pop() if len(given) == 1 else None


def _plain(name: str) -> str:
    """Return a parameter's name without its punctuation: ``wheels.radius`` and ``wheel_radius`` are words in a row."""
    parts = name.rsplit(".", 2)
    last = parts[-1] if parts[-1].lower() not in {*_SIZES, "separation", "track"} else "".join(parts[-2:])
    return last.replace("_", "").replace("-", "").lower()
