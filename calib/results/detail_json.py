"""The part of ``calibration.json`` that the likelihood adds: written and read."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, asdict, fields
from typing import Any, TypeVar

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.likelihood.estimate import Direction, FlaggedCorner, FlaggedLeg, NoiseLevels
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.results.diagnostics import SIDE, Covariance, Detail, Ground, HeldOut, LeaveOneOut, Leg
from boxcal.calib.uncertainty.convergence_point import ConvergencePoint
from boxcal.target.arrays import Array

T = TypeVar("T")


def detail_document(detail: Detail) -> dict[str, Any]:
    """Return the fields that stand beside the calibration's own; what is infinite or undefined becomes null."""
    document: dict[str, Any] = finite(
        {
            "sigma": detail.covariance.sigma,
            "covariance": {"order": ORDER, "side": SIDE, "matrix": detail.covariance.matrix.tolist()},
            "noise": asdict(detail.noise),
            "camera_covariance": covariance_document(detail.camera_covariance),
            "leave_one_out": None if detail.leave_one_out is None else asdict(detail.leave_one_out),
            "effects": detail.effects,
            "scale_sigma": detail.scale_sigma,
            "extra": detail.extra,
            "extra_sigma": detail.extra_sigma,
            "ground": asdict(detail.ground),
            "legs": [asdict(leg) for leg in detail.legs],
            "flagged_legs": [asdict(leg) for leg in detail.flagged_legs],
            "flagged_corners": [asdict(corner) for corner in detail.flagged_corners],
            "directions": [{**asdict(direction), "text": direction.text} for direction in detail.directions],
            "held_out": [asdict(stop) for stop in detail.held_out],
            "growth": [asdict(point) for point in detail.growth],
        }
    )
    return document


def read_detail(document: Mapping[str, Any]) -> Detail | None:
    """Return the detail in a calibration's document, None if there is none.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it is not what :func:`detail_document` makes.
    """
    if "covariance" not in document:
        return None
    covariance = document["covariance"]
    if tuple(covariance["order"]) != ORDER:
        raise ValueError(f"covariance in the order {covariance['order']!r}")
    return Detail(
        covariance=Covariance(matrix=_square(covariance["matrix"], len(ORDER))),
        noise=_one(NoiseLevels, document["noise"]),
        camera_covariance=read_covariance(document.get("camera_covariance")),
        leave_one_out=_one(LeaveOneOut, document["leave_one_out"]) if document.get("leave_one_out") else None,
        effects={str(k): float(v) for k, v in document.get("effects", {}).items()},
        scale_sigma=None if document.get("scale_sigma") is None else float(document["scale_sigma"]),
        extra={str(k): float(v) for k, v in document["extra"].items()},
        extra_sigma={str(k): math.inf if v is None else float(v) for k, v in document["extra_sigma"].items()},
        ground=_one(Ground, document["ground"]),
        legs=_many(Leg, document["legs"]),
        flagged_legs=_many(FlaggedLeg, document["flagged_legs"]),
        flagged_corners=_many(FlaggedCorner, document["flagged_corners"]),
        directions=tuple(_direction(d) for d in document["directions"]),
        held_out=_many(HeldOut, document["held_out"]),
        growth=_many(ConvergencePoint, document["growth"]),
    )


def covariance_document(cov: Covariance | None) -> dict[str, Any] | None:
    """Return a covariance as JSON has it, with its order and its side; None where there is none."""
    return None if cov is None else {"order": cov.names, "side": SIDE, "matrix": cov.matrix.tolist()}


def read_covariance(document: Mapping[str, Any] | None) -> Covariance | None:
    """Return what :func:`covariance_document` made (KeyError, TypeError or ValueError if it did not)."""
    if document is None:
        return None
    names = tuple(str(name) for name in document["order"])
    return Covariance(names=names, matrix=_square(document["matrix"], len(names)))


def _square(rows: Any, n: int) -> Array:
    """Return a covariance (n, n); null is infinite on the diagonal and NaN beside it."""
    matrix = np.array([[math.nan if v is None else v for v in row] for row in rows], dtype=np.float64)
    if matrix.shape != (n, n):
        raise ValueError(f"covariance of shape {matrix.shape}")
    diagonal = np.diag(matrix)
    matrix[np.diag_indices(n)] = np.where(np.isnan(diagonal), np.inf, diagonal)
    return matrix


def _direction(d: Mapping[str, Any]) -> Direction:
    """Return a direction; files of before 0.2 have what and advice in one text."""
    return Direction(
        parameters=tuple((str(name), float(share)) for name, share in d["parameters"]),
        sigma=math.inf if d["sigma"] is None else float(d["sigma"]),
        what=str(d.get("what", d["text"])),
        advice=str(d.get("advice", "")),
    )


def read_finding(document: Mapping[str, Any]) -> Finding:
    """Return a finding; null stands for NaN."""
    numbers = {k: math.nan if document[k] is None else float(document[k]) for k in ("size", "sigma", "p_value")}
    return Finding(
        cause=str(document["cause"]),
        text=str(document["text"]),
        advice=str(document["advice"]),
        adopted=bool(document["adopted"]),
        blocks=bool(document["blocks"]),
        stops=tuple(int(stop) for stop in document["stops"]),
        unit=str(document["unit"]),
        probability=float(document.get("probability", 1.0)),
        **numbers,
    )


def finite(value: Any) -> Any:
    """Return JSON's values with numbers that it has no word for as None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return value


def _one(kind: type[T], values: Mapping[str, Any]) -> T:
    """Return a dataclass from its fields; one with a default may be missing, as in files of earlier versions."""
    return kind(
        **{
            f.name: _tuple(values[f.name])
            for f in fields(kind)  # type: ignore[arg-type]
            if f.name in values or f.default is MISSING
        }
    )


def _many(kind: type[T], rows: Iterable[Mapping[str, Any]]) -> tuple[T, ...]:
    return tuple(_one(kind, row) for row in rows)


def _tuple(value: Any) -> Any:
    """Return lists as tuples and null as infinity: what the dataclasses hold."""
    if isinstance(value, list):
        return tuple(_tuple(v) for v in value)
    return math.inf if value is None else value
