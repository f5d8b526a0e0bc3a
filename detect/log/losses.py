"""Losses of a recording as data: what was lost of it, or what it does not tell, that no good calibration has."""

from dataclasses import dataclass
from enum import StrEnum


class LossKind(StrEnum):
    """Kinds of losses; stable, for programs."""

    DAMAGED = "recording-damaged"
    UNDECODED = "messages-undecoded"
    SIZES_UNKNOWN = "wheel-sizes-unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """One loss of a recording.

    Attributes
    ----------
    kind
        Which.
    text
        The loss in a sentence.
    """

    kind: LossKind
    text: str
