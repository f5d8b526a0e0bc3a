"""Methods of estimating the intrinsics, as they are asked for."""

from enum import StrEnum


class CameraMode(StrEnum):
    """Methods of estimating the intrinsics: jointly over all stops, or stop by stop."""

    JOINT = "joint"
    PER_STOP = "per-stop"
