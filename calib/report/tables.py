"""Rows of the report's tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, log10, pi

import numpy as np

from boxcal.calib.assessment.limits import sentence
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Detail
from boxcal.calib.results.stop_residuals import SeenStop
from boxcal.calib.results.trajectory import DrivenLeg
from boxcal.calib.results.unknowns import describe
from boxcal.target.arrays import Array

_SINGULAR_LOW = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class StopRow:
    """One stop: how long it stood (s), what it saw, how well that fits (px) and how far it was from the box (m)."""

    number: str
    seconds: float
    frames: int
    corners: int
    faces: str
    wrong: int
    rms: float
    distance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceRow:
    """One face over all stops that saw it: root mean square and mean (u, v) of its corners' errors, px."""

    number: int
    corners: int
    stops: int
    rms: float
    mean: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class LegRow:
    """One leg: what was driven (m, deg), odometry minus vision (mm, mm, deg), and why it was rejected, if it was."""

    name: str
    rolled: float
    turned: float
    gap: tuple[float, float, float]
    p: float | None
    used: bool
    fault: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratio:
    """A ratio of singular values and its place on a logarithmic scale from 1e-4 to 1, 0 to 100."""

    name: str
    value: float
    at: float
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtraRow:
    """An unknown beyond the 14 parameters: its name in calibration.json, in words, value and sigma as texts."""

    key: str
    words: str
    value: str
    sigma: str
    unit: str


def stop_row(s: SeenStop) -> StopRow:
    """Return one stop's row."""
    view = s.view
    return StopRow(
        number=s.label,
        seconds=(view.t_end_ns - view.t_start_ns) / 1e9,
        frames=view.frames,
        corners=len(view.landmark_ids),
        faces=", ".join(str(f) for f in np.unique(s.face)),
        wrong=int((~s.used).sum()),
        rms=rms(s.error_px[s.used]),
        distance=float(np.linalg.norm(s.result.T_box_cam[:2, 3])),
    )


def face_row(face: int, seen: Sequence[SeenStop]) -> FaceRow | None:
    """Return one face over all stops; None where it was not seen."""
    errors = [s.error_px[(s.face == face) & s.used] for s in seen]
    total = np.concatenate(errors) if errors else np.zeros((0, 2))
    if not len(total):
        return None
    u, v = total.mean(axis=0).tolist()
    return FaceRow(
        number=face,
        corners=len(total),
        stops=sum(len(e) > 0 for e in errors),
        rms=rms(total),
        mean=(u, v),
    )


def rms(error_px: Array) -> float:
    """Return the root mean square length of errors (N, 2), 0 of none."""
    return float(np.sqrt(np.mean(np.sum(error_px**2, axis=1)))) if len(error_px) else 0.0


def leg_row(leg: DrivenLeg) -> LegRow:
    """Return one leg's row."""
    return LegRow(
        name=leg.name,
        rolled=leg.rolled,
        turned=float(np.degrees(leg.turned)),
        gap=(float(leg.gap[0]) * 1e3, float(leg.gap[1]) * 1e3, float(np.degrees(leg.gap[2]))),
        p=leg.judged.p_value if leg.judged else None,
        used=leg.judged.used if leg.judged else leg.fault is None,
        fault=sentence(leg.fault.text) if leg.fault else "",
    )


_EFFECTS = {
    "lean_rad": ("Lean of the robot", "°", 180 / pi, "roll and pitch, from stop to stop"),
    "height_m": ("Height of the robot", "mm", 1e3, "from stop to stop"),
    "corner_floor_px": ("Floor of a corner's noise", "px", 1.0, "besides the scatter between frames"),
    "growth_px": ("Width of the tags' black", "px", 1.0, "from picture to picture"),
    "print": ("Scale of the sheets", "%", 100.0, "how well the box was made, by the data"),
    "place_m": ("Place of the faces", "mm", 1e3, "likewise"),
    "turn_rad": ("Turn of the faces", "°", 180 / pi, "likewise"),
    "bow_m": ("Bow of the faces", "mm", 1e3, "likewise"),
}
"""Random effects: words, unit, what SI is multiplied with, remark."""


def noise_rows(detail: Detail | None) -> list[tuple[str, str, str]]:
    """Return name, level and remark of each noise."""
    if detail is None:
        return []
    n = detail.noise
    rows = [
        ("Noise of a corner", f"{n.pixel_px:.3f} px", "standard deviation of each coordinate"),
        ("Against the scatter between frames", f"× {n.pixel_factor:.2f}", "1 in the ideal"),
        (
            "Slip of each wheel",
            f"{n.slip * 1e3:.2f} ± {n.slip_sigma * 1e3:.2f} mm",
            "over 1 m; it grows with the square root of the distance",
        ),
    ]
    if n.encoder_step > 0:
        rows.append(("Step of the encoders", f"{np.degrees(n.encoder_step):.4f}°", "found in the readings"))
    else:
        rows.append(("Step of the encoders", "none", "the readings show no steps"))
    rows += [
        (words, f"{detail.effects[name] * scale:.3g} {unit}", remark)
        for name, (words, unit, scale, remark) in _EFFECTS.items()
        if detail.effects.get(name, 0.0) > 0
    ]
    if detail.scale_sigma is not None:
        rows.append(("Size of the print", f"{detail.scale_sigma:.2%}", "on top of every length's sigma"))
    return rows


def singular_ratios(c: Calibration) -> list[Ratio]:
    """Return both ratios with their place, 0 to 100, on a logarithmic scale from 1e-4 to 1."""
    q = c.quality

    def at(value: float) -> float:
        return round(100 * (1 - log10(min(max(value, _SINGULAR_LOW), 1.0)) / log10(_SINGULAR_LOW)), 2)

    return [
        Ratio(
            name="\u03c3\u2085/\u03c3\u2084",
            value=q.sigma5_sigma4,
            at=at(q.sigma5_sigma4),
            text="How well one solution fits all moves: the smaller the better; 0.001 in a simulation, 0.05 on a "
            "real robot in the paper.",
        ),
        Ratio(
            name="\u03c3\u2084/\u03c3\u2083",
            value=q.sigma4_sigma3,
            at=at(q.sigma4_sigma3),
            text="How well the moves tell the parameters apart: the larger the better; 0.7 to 0.8 in the paper, "
            "below 0.001 a drive is refused.",
        ),
    ]


def extra_rows(calibration: Calibration) -> list[ExtraRow]:
    """Return the unknowns beyond the 14 parameters, in words and in the units that people read them in."""
    detail = calibration.detail
    if detail is None:
        return []
    rows = []
    for name, value in {**calibration.camera.further, **detail.extra}.items():
        unknown, sigma = describe(name), detail.extra_sigma.get(name)
        rows.append(
            ExtraRow(
                key=name,
                words=unknown.words,
                value=f"{value * unknown.scale:.3g}".replace("-", "\N{MINUS SIGN}"),
                sigma=""
                if sigma is None
                else f"± {sigma * unknown.scale:.2g}"
                if isfinite(sigma)
                else "not determined",
                unit=unknown.unit,
            )
        )
    return rows


def provenance_rows(c: Calibration) -> list[tuple[str, str]]:
    """Return how the result came about, by name."""
    p = c.provenance
    rows = [("boxcal", p.version), ("Command", p.command), ("Calibrated", p.created), ("Method", c.method)]
    return rows + [(f"SHA-256 of {name}", digest) for name, digest in p.inputs.items()]


def setting_rows(c: Calibration) -> list[tuple[str, str]]:
    """Return the settings of the run, by name, in their units."""
    return [(name, setting(name, value)) for name, value in c.provenance.settings.items()]


_DEG, _MM = (180 / pi, "°"), (1e3, "mm")
UNITS: Mapping[str, tuple[tuple[float, str], ...]] = {
    "tilt_prior": (_DEG,),
    "ink_prior": (_MM,),
    "scale_prior": ((100.0, "%"),),
    "size_prior": (_MM,),
    "face_prior": (_DEG, _MM),
    "bow_prior": (_MM,),
    "encoder_step": (_DEG,),
    "slip": ((1e3, "mm over the first metre"),),
}
"""Settings that have units: what SI is multiplied with, and the unit; of a pair one for each."""


def setting(name: str, value: object) -> str:
    """Return a setting of a run as people read it, in its unit."""
    if value is None:
        return "from the data" if name in UNITS else "not given"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        given = [f"{k}: {setting(k, v)}" for k, v in value.items() if v is not None]
        return ", ".join(given) or "not given"
    if name in UNITS:
        values = value if isinstance(value, list | tuple) else [value]
        pairs = zip(values, UNITS[name], strict=False)
        return ", ".join(f"{float(v) * scale:.4g} {unit}" for v, (scale, unit) in pairs)
    return str(value) or "none"
