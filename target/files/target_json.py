"""The file ``target.json``: a target's dimensions, landmark table and, where known, its true size and shape."""

import hashlib
import json
from dataclasses import asdict, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from boxcal.target.box import Box, Target, make_target
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_atomically
from boxcal.target.files.json_document import read_json
from boxcal.target.measure.measured_size import SIZES, Measured
from boxcal.target.measure.refined_shape import MAX_DRIVES, SHAPE, RefinedShape

SCHEMA = 1
CONSISTENT_M = 1e-9
"""How far a corner in the file may lie from where the file's own dimensions put it, m (rounding only)."""


def target_document(target: Target) -> dict[str, Any]:
    """Return the content of ``target.json`` for a target: ``measured`` and ``refined`` only if the box was."""
    measured, refined = target.measured, target.refined
    return {
        "schema": SCHEMA,
        "units": "m",
        "frame": "box: origin at the centre of its base on the floor, z up; faces 0, 1, 2, 3 look along +x, +y, -x, -y",
        "corner_order": "top-left, top-right, bottom-right, bottom-left, seen from outside with z up",
        "box": asdict(target.box),
        **({} if measured is None else {"measured": _measured_document(measured)}),
        **({} if refined is None else {"refined": _refined_document(refined)}),
        "tags": {
            str(tag): [[round(float(c), 12) + 0.0 for c in corner] for corner in corners]
            for tag, corners in zip(target.tag_ids, target.tag_corners, strict=True)
        },
    }


@lru_cache(maxsize=8)
def target_bytes(target: Target) -> bytes:
    """Return ``target.json`` as bytes: one tag a line, the same bytes for the same target."""
    document = target_document(target)
    tags, refined = document.pop("tags"), document.pop("refined", None)
    head = json.dumps(document, indent=2)
    if refined is not None:  # a row of its covariance a line
        rows = ",\n".join(f"      {json.dumps(row)}" for row in refined.pop("cov"))
        members = "".join(f'    "{name}": {json.dumps(value)},\n' for name, value in refined.items())
        head = f'{head[: head.rindex("}")].rstrip()},\n  "refined": {{\n{members}    "cov": [\n{rows}\n    ]\n  }}\n}}'
    lines = ",\n".join(f'    "{tag}": {json.dumps(corners)}' for tag, corners in tags.items())
    return (head[: head.rindex("}")].rstrip() + ',\n  "tags": {\n' + lines + "\n  }\n}\n").encode()


@lru_cache(maxsize=8)
def target_sha256(target: Target) -> str:
    """Return the hash that names a landmark table in results."""
    return hashlib.sha256(target_bytes(target)).hexdigest()


def design_sha256(target: Target) -> str:
    """Return the hash that names a design: the same before and after its box was measured, and measured anew."""
    as_designed = target.measured is None and target.refined is None
    return target_sha256(target if as_designed else make_target(target.box))


def save_target(target: Target, path: str | Path) -> None:
    """Write ``target.json`` (atomically).

    Examples
    --------
    >>> import boxcal
    >>> boxcal.save_target(boxcal.make_target(), "box/target.json")
    """
    write_atomically(Path(path), target_bytes(target))


def given_target(target: Target | str | Path | None) -> Target:
    """Return the box that a caller means: a target, the path of its ``target.json``, or None for the default box.

    Errors as of :func:`load_target`.
    """
    if isinstance(target, Target):
        return target
    return make_target() if target is None else load_target(target)


def load_target(path: str | Path) -> Target:
    """Read and check a ``target.json``.

    Raises
    ------
    TargetError
        If the file is missing, is no such file, has another schema, impossible dimensions, or corners that do not agree
        with its dimensions.

    Examples
    --------
    >>> import boxcal
    >>> boxcal.save_target(boxcal.make_target(), "box/target.json")
    >>> target = boxcal.load_target("box/target.json")
    >>> target.tag_corners[0, 0]  # m, frame box: the first tag's top left corner
    array([ 0.125, -0.119,  0.184])
    """
    path = Path(path)
    name = path.name
    document = read_json(path, "a target file", error=TargetError, remedy="make one with make-target")
    if "schema" not in document or "tags" not in document:
        raise TargetError("no target description in it", source=name, remedy="make one with make-target")
    if document["schema"] != SCHEMA:
        raise TargetError(
            f"schema {document['schema']!r}, this version reads {SCHEMA}",
            source=name,
            remedy="make it again with make-target",
        )
    if document.get("units") != "m":
        raise TargetError(
            f"units {document.get('units')!r}, metres ('m') are needed", source=name, remedy="make it again"
        )
    box, measured = _box(name, document.get("box")), _measured(name, document.get("measured"))
    refined = _refined(name, document.get("refined"))
    try:
        target = make_target(box, measured, refined)
    except TargetError as error:
        raise TargetError(f"{error}", source=name) from error
    _check_tags(name, document["tags"], target)
    return target


def _box(name: str, figures: object) -> Box:
    expected = {f.name: type(f.default) for f in fields(Box)}
    if not isinstance(figures, dict) or set(figures) != set(expected):
        raise TargetError(
            f"'box' must hold {', '.join(expected)}", source=name, remedy="make it again with make-target"
        )
    for key, kind in expected.items():
        value = figures[key]
        fits = isinstance(value, (int, float)) if kind is float else isinstance(value, kind)
        if isinstance(value, bool) or not fits:
            raise TargetError(
                f"box.{key} is {value!r}, a {kind.__name__} is needed", source=name, remedy="make it again"
            )
    try:
        return Box(**figures)
    except TargetError as error:
        raise TargetError(f"{error}", source=name) from error
    except OverflowError as error:
        raise TargetError(
            "a dimension of 'box' is too large", source=name, remedy="make it again with make-target"
        ) from error


def _measured_document(measured: Measured) -> dict[str, Any]:
    return {name: getattr(measured, name) for name in SIZES} | {"cov_order": list(SIZES), "cov": measured.cov.tolist()}


def _measured(name: str, figures: object) -> Measured | None:
    if figures is None:
        return None
    if not isinstance(figures, dict) or set(figures) != {*SIZES, "cov_order", "cov"}:
        raise TargetError(
            f"'measured' must hold {', '.join(SIZES)}, cov_order, cov",
            source=name,
            remedy="make it again with measure-target",
        )
    if figures["cov_order"] != list(SIZES):
        raise TargetError(
            f"measured.cov_order must be {', '.join(SIZES)}", source=name, remedy="make it again with measure-target"
        )
    for key in SIZES:
        if isinstance(figures[key], bool) or not isinstance(figures[key], (int, float)):
            raise TargetError(
                f"measured.{key} is {figures[key]!r}, a float is needed", source=name, remedy="make it again"
            )
    try:
        cov = np.array(figures["cov"], dtype=np.float64)
        return Measured(cov=cov, **{key: float(figures[key]) for key in SIZES})
    except TargetError as error:
        raise TargetError(f"{error}", source=name) from error
    except (ValueError, TypeError, OverflowError) as error:
        raise TargetError(
            "measured dimensions and cov must be numbers", source=name, remedy="make it again with measure-target"
        ) from error


def _refined_document(refined: RefinedShape) -> dict[str, Any]:
    return {
        "order": list(SHAPE),
        "values": refined.values.tolist(),
        "robots": refined.robots,
        "drives": list(refined.drives),
        "cov": refined.cov.tolist(),
    }


def _refined(name: str, figures: object) -> RefinedShape | None:
    if figures is None:
        return None
    remedy = "refine it again with fleet-calibrate --joint-box"
    wanted = ("order", "values", "robots", "drives", "cov")
    if not isinstance(figures, dict) or set(figures) != set(wanted):
        raise TargetError(f"'refined' must hold {', '.join(wanted)}", source=name, remedy=remedy)
    robots, drives = figures["robots"], figures["drives"]
    if figures["order"] != list(SHAPE):
        raise TargetError("refined.order is not that of this version", source=name, remedy=remedy)
    if isinstance(robots, bool) or not isinstance(robots, int) or robots < 1:
        raise TargetError(f"refined.robots is {robots!r}, a positive number is needed", source=name, remedy=remedy)
    if not (isinstance(drives, list) and len(drives) <= MAX_DRIVES and all(isinstance(d, str) for d in drives)):
        raise TargetError("refined.drives must be a list of texts", source=name, remedy=remedy)
    try:
        values, cov = (np.array(figures[key], dtype=np.float64) for key in ("values", "cov"))
        return RefinedShape(values=values, cov=cov, robots=robots, drives=tuple(drives))
    except TargetError as error:
        raise TargetError(f"{error}", source=name) from error
    except (ValueError, TypeError, OverflowError) as error:
        raise TargetError("refined values and cov must be numbers", source=name, remedy=remedy) from error


def _check_tags(name: str, tags: object, target: Target) -> None:
    wanted = {str(t) for t in target.tag_ids}
    if not isinstance(tags, dict) or set(tags) != wanted:
        found = len(tags) if isinstance(tags, dict) else 0
        raise TargetError(
            f"{found} tags, its dimensions need ids {target.tag_ids[0]} to {target.tag_ids[-1]}",
            source=name,
            remedy="make it again",
        )
    try:
        corners = np.array([tags[str(t)] for t in target.tag_ids], dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise TargetError(
            "a tag's corners are not 4 points of 3 numbers", source=name, remedy="make it again"
        ) from error
    if corners.shape != target.tag_corners.shape:
        raise TargetError("a tag's corners are not 4 points of 3 numbers", source=name, remedy="make it again")
    off = np.abs(corners - target.tag_corners).max(axis=(1, 2))
    if not np.all(off <= CONSISTENT_M):
        worst = int(np.argmax(np.nan_to_num(off, nan=np.inf)))
        raise TargetError(
            f"corners of tag {target.tag_ids[worst]} lie {off[worst] * 1e3:.3g} mm from where the file's own "
            "dimensions put them",
            source=name,
            remedy="do not edit corners by hand, make it again with make-target",
        )
