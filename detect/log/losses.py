"""Losses of a recording as data: what was lost of it, or what it does not say, that no good calibration has."""

from dataclasses import dataclass
from enum import StrEnum

MOST_STRAYS = 0.02
"""Largest part of a signal's readings that may be wrong and be taken out as strays.

A reading is found astray by its neighbours, which have to be right themselves; where more are off, they are taken for
the signal itself. Messages damaged in transfer show about as often in their frame (lengths, names), so that they do
not decode, as in their numbers, so that they do: where more than this part does not decode, or is no number, as
many wrong numbers may be among the rest as no filter takes out.
"""


class LossKind(StrEnum):
    """Kinds of losses; stable, for programs."""

    DAMAGED = "recording-damaged"
    UNDECODED = "messages-undecoded"
    NO_NUMBERS = "readings-no-numbers"
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
