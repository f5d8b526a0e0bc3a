"""Nominal wheels of a data sheet, read from YAML, JSON or the robot's URDF."""

import math
from collections.abc import Iterator
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.calib.settings import Nominal
from boxcal.detect.errors import DetectError
from boxcal.detect.log.urdf_wheels import urdf_wheels
from boxcal.detect.log.wheel_parameters import DriverWheels, driver_wheels, says_of_wheels

MAX_YAML_BYTES = 1 << 16
MAX_URDF_BYTES = 16 << 20
_MAX_DEPTH = 30


def load_nominal(path: Path) -> Nominal:
    """Read nominal wheels.

    YAML or JSON (also the parameters of a diff_drive_controller or of a robot's node): ``wheel_radius`` and
    ``wheel_separation`` side by side, at any depth, or what drivers call them. URDF (``.urdf``, ``.xml``): the two
    driven wheels' cylinders or spheres, and where their joints are.

    Raises
    ------
    CalibError
        If the file is missing, too large or says nothing of the wheels: what was found and what is needed.
    """
    urdf = path.suffix.lower() in {".urdf", ".xml", ".xacro"}
    limit = MAX_URDF_BYTES if urdf else MAX_YAML_BYTES
    try:
        size = path.stat().st_size
        if size > limit:
            raise CalibError(
                f"{size} bytes, at most {limit} are read",
                source=path.name,
                remedy="give wheel_radius and wheel_separation in a YAML file of their own",
            )
        content = path.read_bytes()
    except OSError as error:
        raise CalibError(
            f"cannot be read ({error.strerror or error})", source=path.name, remedy="check --nominal"
        ) from error
    try:
        found = _urdf_wheels(content, path.name) if urdf else _yaml_wheels(content, path.name)
    except DetectError as error:
        raise CalibError(error.found, source=error.source, needed=error.needed, remedy=error.remedy) from error
    for name, value in (("wheel_radius", found.radius), ("wheel_separation", found.separation)):
        if not (math.isfinite(value) and 0 < value < 100):
            raise CalibError(
                f"{name} is {value:g}, a positive number of metres is needed", source=path.name, remedy="correct it"
            )
    return Nominal(
        wheel_radius=found.radius,
        wheel_separation=found.separation,
        source=path.name,
        multipliers=(found.right, found.left, found.apart),
    )


def _urdf_wheels(content: bytes, name: str) -> DriverWheels:
    radius, separation = urdf_wheels(content, name)
    return DriverWheels(radius=radius, separation=separation)


def _yaml_wheels(content: bytes, name: str) -> DriverWheels:
    from ruamel.yaml import YAML  # noqa: PLC0415  (only where a nominal file is given)
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415
    from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent  # noqa: PLC0415

    yaml = YAML(typ="safe", pure=True)
    try:
        depth = 0
        for event in yaml.parse(content):
            depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
            if isinstance(event, AliasEvent) or depth > _MAX_DEPTH:
                raise CalibError(
                    "nested deeply or with YAML aliases, which are not read", source=name, remedy="write the values out"
                )
        document = yaml.load(content)
    except (YAMLError, ValueError, RecursionError, TypeError) as error:
        line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CalibError(
            f"not YAML ({line})", source=name, remedy="give wheel_radius and wheel_separation, in metres"
        ) from error
    nodes = [driver_wheels({n: _metres(v, name) for n, v in _named(mapping)}) for mapping in _mappings(document)]
    given = {wheels for wheels in nodes if wheels is not None}
    if len(given) != 1:
        found = "no wheel_radius with a wheel_separation" if not given else f"{len(given)} different pairs of them"
        raise CalibError(
            f"{found}, one of each side by side is needed", source=name, remedy="give a file with just these two"
        )
    return given.pop()


def _named(mapping: dict[object, object]) -> Iterator[tuple[str, object]]:
    """Yield what a mapping says of wheels by its name: ``wheel_radius``, and ``radius`` below ``wheels``."""
    for key, value in mapping.items():
        inner = value.items() if isinstance(value, dict) else ()
        for name, found in ((str(key), value), *((f"{key}.{k}", v) for k, v in inner)):
            if says_of_wheels(name) and not isinstance(found, dict | list):
                yield name, found


def _mappings(document: object) -> Iterator[dict[object, object]]:
    """Yield all mappings of a document."""
    waiting = [document]
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict):
            yield node
            waiting.extend(node.values())
        elif isinstance(node, list):
            waiting.extend(node)


def _metres(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibError(f"{str(value)[:40]!r} is no number, metres are needed", source=name, remedy="correct it")
    try:
        return float(value)
    except OverflowError as error:
        raise CalibError("a length of over 1e308 m", source=name, remedy="correct it") from error
