"""Wheels, camera and camera extrinsics with their uncertainty, and what that means on the ground."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from boxcal.calib.assessment.limits import length
from boxcal.calib.results.calibration import Calibration
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One parameter as a table shows it.

    Attributes
    ----------
    key
        Short name, as in calibration.json where it stands there.
    name
        In words.
    value, sigma
        In ``unit``; sigma is infinite where the drive does not determine it, None for the closed form.
    unit
        Of both.
    meaning
        What the sigma does, in words; empty without one.
    digits
        After the point, for the value.
    """

    key: str
    name: str
    value: float
    sigma: float | None
    unit: str
    meaning: str
    digits: int

    @property
    def value_text(self) -> str:
        """The value, with as many digits as its sigma leaves meaning."""
        return f"{self.value:.{self._places()}f}".replace("-", "\N{MINUS SIGN}")

    @property
    def sigma_text(self) -> str:
        """The standard deviation, to two significant digits."""
        if self.sigma is None:
            return ""
        return f"{self.sigma:.{self._places()}f}" if isfinite(self.sigma) else "not determined"

    def _places(self) -> int:
        if self.sigma is None or not isfinite(self.sigma) or self.sigma <= 0:
            return self.digits
        return min(max(0, 1 - int(np.floor(np.log10(self.sigma)))), self.digits + 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Parameters that belong together."""

    title: str
    rows: tuple[Row, ...]


def parameter_groups(c: Calibration) -> tuple[Group, ...]:
    """Return the wheels, the camera and its extrinsics."""
    return (
        Group(title="Wheels", rows=_wheels(c)),
        Group(title="Camera", rows=_camera(c)),
        Group(title="Camera extrinsics", rows=_place(c) + _turns(c)),
    )


def _wheels(c: Calibration) -> tuple[Row, ...]:
    w = c.wheels

    def of_path(radius: float) -> Callable[[float], str]:
        return lambda s: f"{length(10 * s / radius)} of its way in 10 m"

    def turn(s: float) -> str:
        return f"{360 * s / w.b:.2f}° in a whole turn"

    return (
        _row(c, "rL", "Left wheel, radius", w.rL, of_path(w.rL), unit="mm"),
        _row(c, "rR", "Right wheel, radius", w.rR, of_path(w.rR), unit="mm"),
        _row(c, "b", "Wheel separation", w.b, turn, unit="mm"),
    )


def _camera(c: Calibration) -> tuple[Row, ...]:
    k, (width, height) = c.camera, c.image_size
    f = (k.fu + k.fv) / 2
    rim2 = ((width / 2 / k.fu) ** 2 + (height / 2 / k.fv) ** 2) ** 0.5

    def edge(focal: float, half: float, which: str) -> Callable[[float], str]:
        return lambda s: f"{s / focal * half:.2f} px at the {which} edge"

    def view(s: float) -> str:
        return f"{np.degrees(s / f):.3f}° of the view"

    def corners(s: float) -> str:
        return f"{s * rim2**3 * f:.2f} px in the image's corners"

    return (
        _row(c, "fu", "Focal length, across", k.fu, edge(k.fu, width / 2, "left and right"), digits=2),
        _row(c, "fv", "Focal length, down", k.fv, edge(k.fv, height / 2, "top and bottom"), digits=2),
        _row(c, "cu", "Principal point, across", k.cu, view, digits=2),
        _row(c, "cv", "Principal point, down", k.cv, view, digits=2),
        _row(c, "kr", "Radial distortion", k.kr, corners, unit="", digits=4),
    )


def _place(c: Calibration) -> tuple[Row, ...]:
    names = {"tx": "Forward", "ty": "To the left", "tz": "Above the floor"}

    def shift(s: float) -> str:
        return f"shifts all that is seen by {length(s)}"

    return tuple(
        _row(c, key, name, float(v), shift, unit="mm", digits=1)
        for (key, name), v in zip(names.items(), c.T_body_cam[:3, 3], strict=True)
    )


def _turns(c: Calibration) -> tuple[Row, ...]:
    names = {"yaw": "Yaw, to the left", "pitch": "Pitch, down", "roll": "Roll"}
    angles, sigma = np.degrees(c.yaw_pitch_roll), np.degrees(c.yaw_pitch_roll_sigma) if c.detail else None
    return tuple(
        Row(
            key=key,
            name=name,
            value=float(angles[i]),
            sigma=None if sigma is None else float(sigma[i]),
            unit="°",
            meaning=_at_two_metres(sigma, i),
            digits=2,
        )
        for i, (key, name) in enumerate(names.items())
    )


def _row(
    c: Calibration, key: str, name: str, value: float, say: Callable[[float], str], *, unit: str = "px", digits: int = 3
) -> Row:
    """Return a row; ``value`` in SI or px, ``say`` says what a sigma in the same unit does."""
    scale = 1e3 if unit == "mm" else 1.0
    sigma = c.detail.covariance.sigma[key] if c.detail else None
    return Row(
        key=key,
        name=name,
        value=value * scale,
        sigma=None if sigma is None else sigma * scale,
        unit=unit,
        meaning=say(sigma) if sigma is not None and isfinite(sigma) else "",
        digits=digits,
    )


def _at_two_metres(sigma_deg: Array | None, i: int) -> str:
    if sigma_deg is None or not isfinite(sigma_deg[i]):
        return ""
    return f"{length(2 * float(sigma_deg[i]) * pi / 180)} at a distance of 2 m"
