"""Provenance of correspondences: the recording, what was read of it, and how."""

from dataclasses import dataclass, fields
from typing import Any

from boxcal.detect.log.losses import Loss, LossKind
from boxcal.detect.log.recording import Recording


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
        The robot's base frame, as its odometry or its static transforms name it; empty if the log does not tell.
    wheel_topics, wheel_quantity
        Where the wheels' readings are, and what they are: ``positions``, ``velocities``, ``ticks`` or ``odometry``.
    nominal_radius, nominal_separation : m
        Of the wheels as the robot's description in the log has them, or as odometry was taken apart with; 0 if
        unknown.
    nominal_T_base_cam : (16,), row by row
        The camera's pose in the base frame by the static transforms of the log; empty if they do not tell.
    clock_offset : s
        By how much the camera's clock was ahead of the wheels' before its stamps were put right.
    lost_messages, lost_s
        What of the log could not be read, as far as that is known.
    losses
        What of that, and of what the log does not tell, no good calibration has; the notes say it, too.
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
        log=recording.path.name,
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
    """Return the provenance in a file; what newer versions add is passed over, what older ones lack is unknown."""
    known = {field.name for field in fields(Source)}
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in saved.items() if name in known
    }
    losses = tuple(Loss(kind=LossKind(loss["kind"]), text=str(loss["text"])) for loss in values.pop("losses", ()))
    return Source(**values, losses=losses)
