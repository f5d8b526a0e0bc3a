"""Ways to estimate the intrinsics, as they are asked for."""

from enum import StrEnum


class CameraMode(StrEnum):
    """Ways to estimate the intrinsics: jointly over all stops, or stop by stop."""

    JOINT = "joint"
    PER_STOP = "per-stop"
