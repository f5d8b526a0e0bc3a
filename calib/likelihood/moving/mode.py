"""Use of frames on the move, as it is asked for."""

from enum import StrEnum


class Moving(StrEnum):
    """Use of frames on the move: where the data allow it, always (else the drive is refused), or never."""

    AUTO = "auto"
    ON = "on"
    OFF = "off"
