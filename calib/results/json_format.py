"""The part of ``calibration.json`` that the likelihood adds: written and read."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any, TypeVar

import numpy as np

from boxcal.calib.likelihood.estimate import Direction, FlaggedCorner, FlaggedLeg, NoiseLevels
from boxcal.calib.results.diagnostics import ORDER, SIDE, Covariance, Detail, Ground, Growth, HeldOut, Leg

T = TypeVar("T")


def detail_document(detail: Detail) -> dict[str, Any]:
    """Return the fields that stand beside the calibration's own; what is infinite or undefined becomes null."""
    document: dict[str, Any] = _finite(
        {
            "sigma": detail.covariance.sigma,
            "covariance": {"order": ORDER, "side": SIDE, "matrix": detail.covariance.matrix.tolist()},
            "noise": asdict(detail.noise),
            "extra": detail.extra,
            "extra_sigma": detail.extra_sigma,
            "ground": asdict(detail.ground),
            "legs": [asdict(leg) for leg in detail.legs],
            "flagged_legs": [asdict(leg) for leg in detail.flagged_legs],
            "flagged_corners": [asdict(corner) for corner in detail.flagged_corners],
            "directions": [asdict(direction) for direction in detail.directions],
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
    matrix = np.array([[math.nan if v is None else v for v in row] for row in covariance["matrix"]], dtype=np.float64)
    if matrix.shape != (len(ORDER), len(ORDER)):
        raise ValueError(f"covariance of shape {matrix.shape}")
    diagonal = np.diag(matrix)
    matrix[np.diag_indices(len(ORDER))] = np.where(np.isnan(diagonal), np.inf, diagonal)
    return Detail(
        covariance=Covariance(matrix=matrix),
        noise=_one(NoiseLevels, document["noise"]),
        extra={str(k): float(v) for k, v in document["extra"].items()},
        extra_sigma={str(k): math.inf if v is None else float(v) for k, v in document["extra_sigma"].items()},
        ground=_one(Ground, document["ground"]),
        legs=_many(Leg, document["legs"]),
        flagged_legs=_many(FlaggedLeg, document["flagged_legs"]),
        flagged_corners=_many(FlaggedCorner, document["flagged_corners"]),
        directions=tuple(
            Direction(
                parameters=tuple((str(name), float(share)) for name, share in d["parameters"]),
                sigma=math.inf if d["sigma"] is None else float(d["sigma"]),
                text=str(d["text"]),
            )
            for d in document["directions"]
        ),
        held_out=_many(HeldOut, document["held_out"]),
        growth=_many(Growth, document["growth"]),
    )


def _finite(value: Any) -> Any:
    """Return JSON's values with numbers that it has no word for as None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return value


def _one(kind: type[T], values: Mapping[str, Any]) -> T:
    names = [f.name for f in fields(kind)]  # type: ignore[arg-type]
    return kind(**{name: _tuple(values[name]) for name in names})


def _many(kind: type[T], rows: Iterable[Mapping[str, Any]]) -> tuple[T, ...]:
    return tuple(_one(kind, row) for row in rows)


def _tuple(value: Any) -> Any:
    """Return lists as tuples and null as infinity: what the dataclasses hold."""
    if isinstance(value, list):
        return tuple(_tuple(v) for v in value)
    return math.inf if value is None else value
