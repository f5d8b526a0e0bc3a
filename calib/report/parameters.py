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
        """The standard deviation, with two figures."""
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
    sigma = c.detail.covariance.sigma if c.detail else None
    angle_sigma = np.degrees(c.yaw_pitch_roll_sigma) if c.detail else None
    f, half = (c.camera.fu + c.camera.fv) / 2, c.image_size[0] / 2
    rim2 = ((c.image_size[0] / 2 / c.camera.fu) ** 2 + (c.image_size[1] / 2 / c.camera.fv) ** 2) ** 0.5

    def row(  # noqa: PLR0917  called as a table is read, by column
        key: str, name: str, value: float, unit: str, scale: float, digits: int, say: Callable[[float], str]
    ) -> Row:
        s = None if sigma is None else sigma[key]
        meaning = say(s) if s is not None and isfinite(s) else ""
        return Row(
            key=key,
            name=name,
            value=value * scale,
            sigma=None if s is None else s * scale,
            unit=unit,
            meaning=meaning,
            digits=digits,
        )

    w, k, t = c.wheels, c.camera, c.T_body_cam[:3, 3]
    wheels = (
        row("rL", "Left wheel, radius", w.rL, "mm", 1e3, 3, lambda s: f"{length(10 * s / w.rL)} of its way in 10 m"),
        row("rR", "Right wheel, radius", w.rR, "mm", 1e3, 3, lambda s: f"{length(10 * s / w.rR)} of its way in 10 m"),
        row("b", "Wheel separation", w.b, "mm", 1e3, 3, lambda s: f"{360 * s / w.b:.2f}° in a whole turn"),
    )
    camera = (
        row(
            "fu",
            "Focal length, across",
            k.fu,
            "px",
            1,
            2,
            lambda s: f"{s / k.fu * half:.2f} px at the left and right edge",
        ),
        row(
            "fv",
            "Focal length, down",
            k.fv,
            "px",
            1,
            2,
            lambda s: f"{s / k.fv * c.image_size[1] / 2:.2f} px at the top and bottom edge",
        ),
        row(
            "cu",
            "Principal point, across",
            k.cu,
            "px",
            1,
            2,
            lambda s: f"{np.degrees(s / f):.3f}° of the view",
        ),
        row(
            "cv",
            "Principal point, down",
            k.cv,
            "px",
            1,
            2,
            lambda s: f"{np.degrees(s / f):.3f}° of the view",
        ),
        row("kr", "Radial distortion", k.kr, "", 1, 4, lambda s: f"{s * rim2**3 * f:.2f} px in the image's corners"),
    )
    place = tuple(
        row(key, name, float(v), "mm", 1e3, 1, lambda s: f"shifts all that is seen by {length(s)}")
        for key, name, v in zip(("tx", "ty", "tz"), ("Forward", "To the left", "Above the floor"), t, strict=True)
    )
    angles = np.degrees(c.yaw_pitch_roll)
    turns = tuple(
        Row(
            key=key,
            name=name,
            value=float(v),
            sigma=None if angle_sigma is None else float(angle_sigma[i]),
            unit="°",
            meaning=_at_two_metres(angle_sigma, i),
            digits=2,
        )
        for i, (key, name, v) in enumerate(
            zip(("yaw", "pitch", "roll"), ("Yaw, to the left", "Pitch, down", "Roll"), angles, strict=True)
        )
    )
    return (
        Group(title="Wheels", rows=wheels),
        Group(title="Camera", rows=camera),
        Group(title="Camera extrinsics", rows=place + turns),
    )


def _at_two_metres(sigma_deg: Array | None, i: int) -> str:
    if sigma_deg is None or not isfinite(sigma_deg[i]):
        return ""
    return f"{length(2 * float(sigma_deg[i]) * pi / 180)} at a distance of 2 m"
