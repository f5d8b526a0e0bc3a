"""Provenance of correspondences: the recording, what was read of it, and how."""

from dataclasses import dataclass, fields
from math import inf, isfinite
from typing import Any

from boxcal.detect.log.losses import Loss, LossKind
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.safe_text import printable
from boxcal.target.box import FACES
from boxcal.target.errors import one_line


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Source of correspondences: log and target by their hashes.

    Attributes
    ----------
    log
        File name of the log (no folder).
    sha256
        Of the log's bytes, hexadecimal.
    target_sha256
        Of the landmark table that was looked for.
    kind
        Kind of recording.
    camera_topic, camera_frame
        Where the images are, and the frame that they name.
    base_frame
        The robot's base frame, as its odometry or its static transforms name it; empty if the log does not say.
    wheel_topics, wheel_quantity
        Where the wheels' readings are, and what they are: ``positions``, ``velocities``, ``ticks`` or ``odometry``.
    nominal_radius, nominal_separation : m
        Of the wheels as the robot's description in the log has them, or as odometry was taken apart with; 0 if
        unknown.
    nominal_T_base_cam : (16,), row by row
        The camera's pose in the base frame by the static transforms of the log; empty if they do not say.
    clock_offset : s
        By how much the camera's clock was ahead of the wheels' before its stamps were put right.
    print_sizes : (FACES,)
        Sizes of the faces' prints over that of most, where the images show that they differ; else empty.
    lost_messages, lost_s
        What of the log could not be read, as far as that is known.
    losses
        What of that, and of what the log does not say, no good calibration has; the notes say it, too.
    notes
        What a user should know of how the log was read: choices, losses, what was put right. A sentence each.
    """

    log: str = ""
    sha256: str = ""
    target_sha256: str = ""
    kind: str = ""
    camera_topic: str = ""
    camera_frame: str = ""
    base_frame: str = ""
    wheel_topics: tuple[str, ...] = ()
    wheel_quantity: str = "positions"
    nominal_radius: float = 0.0
    nominal_separation: float = 0.0
    nominal_T_base_cam: tuple[float, ...] = ()
    clock_offset: float = 0.0
    print_sizes: tuple[float, ...] = ()
    lost_messages: int = 0
    lost_s: float = 0.0
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()


def source_of(recording: Recording, target_sha256: str, notes: tuple[str, ...]) -> Source:
    """Return the provenance of what is extracted from a recording."""
    about = recording.metadata
    radius, separation = recording.nominal or about.nominal_wheels() or (0.0, 0.0)
    base = recording.odometry_frame or about.base_frame()
    T_base_cam = about.fixed_transform(base, recording.camera_frame)
    return Source(
        log=one_line(recording.path.name),
        sha256=recording.sha256,
        target_sha256=target_sha256,
        kind=recording.kind,
        camera_topic=recording.camera_topic,
        camera_frame=recording.camera_frame,
        base_frame=base,
        wheel_topics=recording.wheel_topics,
        wheel_quantity=str(recording.quantity),
        nominal_radius=radius,
        nominal_separation=separation,
        nominal_T_base_cam=() if T_base_cam is None else tuple(float(v) for v in T_base_cam.ravel()),
        clock_offset=recording.clock_offset_ns / 1e9,
        lost_messages=recording.lost_messages,
        lost_s=recording.lost_s,
        losses=recording.losses,
        notes=(*recording.notes, *notes),
    )


def read_source(saved: dict[str, Any]) -> Source:
    """Return the provenance in a file; what newer versions add is passed over, what older ones lack is unknown.

    Texts come back as single lines without control characters: files are passed on, and what they say is printed.

    Raises
    ------
    ValueError
        If a value is not of its field's kind.
    """
    if not isinstance(saved, dict):
        raise ValueError(f"a source of {_brief(saved)}")
    values: dict[str, Any] = {
        field.name: _as(field.default, saved[field.name], field.name)
        for field in fields(Source)
        if field.name in saved and field.name not in _NUMBERS and field.name != "losses"
    }
    values |= {name: _numbers(name, saved.get(name, []), *kind) for name, kind in _NUMBERS.items()}
    losses = tuple(
        Loss(kind=LossKind(loss["kind"]), text=str(_as("", loss["text"], "losses"))) for loss in saved.get("losses", ())
    )
    return Source(**values, losses=losses)


def _as(default: object, value: object, name: str) -> object:
    """Return a value that has the kind of a field's default: text, a whole number, a finite number, or texts."""
    if isinstance(default, tuple) and isinstance(value, list):
        return tuple(_as("", part, name) for part in value)
    if isinstance(default, str) and isinstance(value, str):
        return one_line(value)
    if isinstance(default, int) and isinstance(value, int):
        return value
    if isinstance(default, float) and isinstance(value, (int, float)) and isfinite(value):
        return float(value)
    raise ValueError(f"{name} of {_brief(value)}")


_NUMBERS = {"nominal_T_base_cam": (16, -inf, inf), "print_sizes": (FACES, 0.5, 2.0)}
"""Fields that hold so many numbers, or none, and between which limits these lie."""


def _numbers(name: str, value: object, count: int, least: float, most: float) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) not in {0, count}:
        raise ValueError(f"{name} of {_brief(value)}")
    if not all(isinstance(part, (int, float)) and isfinite(part) and least <= part <= most for part in value):
        raise ValueError(f"{name} of {_brief(value)}")
    return tuple(float(part) for part in value)


def _brief(value: object) -> str:
    return printable(repr(value))
