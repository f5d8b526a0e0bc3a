"""Shape of one built box, refined from what many robots saw of it, with its covariance."""

from dataclasses import dataclass

import cv2
import numpy as np

from boxcal.target.arrays import Array
from boxcal.target.errors import TargetError

SIDES = 4
FACE_AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
"""A face's motion in its own frame: right, up, outward (m), then turns about these axes (rad)."""
SHAPE = (
    *("scale_x", "scale_y", "seat"),
    *(f"bow{f}" for f in range(SIDES)),
    *(f"face{f}_{axis}" for f in range(SIDES) for axis in FACE_AXES),
)
"""Unknowns of a built box, in the order of values and covariance: see :class:`RefinedShape`."""
CREDIBLE_SCALE, CREDIBLE_M, CREDIBLE_RAD = 0.2, 0.05, 0.2
"""A box further from its description than this is another box."""
MAX_DRIVES = 100_000
_SYMMETRIC = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RefinedShape:
    """Departure of a built box from its description (design or measured sizes), as a fleet of robots found it.

    A point p of a face's print, in the frame of the face, lies at ``T_box_face exp(w, t) (p + scale p + bow s)``: the
    scales act along x and y, the bow along z with ``s = 1 - (x / half width)^2``, and ``t`` is ``(tx, ty + seat, tz)``.

    Attributes
    ----------
    values : (31,)
        In the order of :data:`SHAPE`: ``scale_x, scale_y`` (relative), ``seat`` (m), ``bow0`` ... ``bow3`` (m),
        ``face0_tx`` ... ``face3_rz`` (m, rad).
    cov : (31, 31)
        Their covariance; zero for what was taken as described.
    robots
        How many robots it was found from.
    drives
        Names of the drives that it was found from (hashes): their own calibrations must not count it as news.
    """

    values: Array
    cov: Array
    robots: int
    drives: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(SHAPE)
        if self.values.shape != (n,) or self.cov.shape != (n, n):
            raise TargetError(f"refined shape: {n} values and {n} rows of {n} numbers are needed")
        if not (np.all(np.isfinite(self.values)) and np.all(np.isfinite(self.cov))):
            raise TargetError("refined shape: a value is not finite")
        sigma = np.sqrt(np.maximum(np.diag(self.cov), 0.0))
        unit = np.where(sigma > 0, sigma, 1.0)
        scaled = self.cov / np.outer(unit, unit)
        if np.abs(scaled - scaled.T).max() > _SYMMETRIC or np.linalg.eigvalsh(scaled)[0] < -_SYMMETRIC:
            raise TargetError("refined covariance: it is no covariance (symmetric, no negative variance)")
        for name, value in zip(SHAPE, self.values.tolist(), strict=True):
            limit = CREDIBLE_SCALE if name.startswith("scale") else CREDIBLE_RAD if "_r" in name else CREDIBLE_M
            if abs(value) > limit:
                raise TargetError(
                    f"refined {name} is {value:.3g}, at most {limit:g} is credible", remedy="is it another box?"
                )

    def value(self, name: str) -> float:
        """Return one of the values (ValueError for a name that is none)."""
        return float(self.values[SHAPE.index(name)])

    def sigma(self, name: str) -> float:
        """Return the standard deviation of one of the values (ValueError for a name that is none)."""
        k = SHAPE.index(name)
        return float(np.sqrt(max(self.cov[k, k], 0.0)))


def on_built_face(shape: RefinedShape, face: int, p_face: Array, half_width: float) -> Array:
    """Return where points of a face's print are on the box as built, (..., 3) m, in the frame of the described face.

    Parameters
    ----------
    shape
        Of the box.
    face
        Number of the face.
    p_face : (..., 2), m
        Points as described: x right and y up from the face's centre.
    half_width : m
        Half of the face's width, where its bow ends.
    """
    x, y = p_face[..., 0], p_face[..., 1]
    p = np.stack(
        [
            x * (1 + shape.value("scale_x")),
            y * (1 + shape.value("scale_y")),
            shape.value(f"bow{face}") * (1 - (x / half_width) ** 2),
        ],
        axis=-1,
    )
    tx, ty, tz, rx, ry, rz = (shape.value(f"face{face}_{axis}") for axis in FACE_AXES)
    R = np.asarray(cv2.Rodrigues(np.array([rx, ry, rz]))[0])
    return np.asarray(p @ R.T + (tx, ty + shape.value("seat"), tz))
