"""Whether a calibration can be used, and why: the judgement that it carries."""

from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """GOOD: use it. USABLE: use it with care. REDO: do not use it."""

    GOOD = "good"
    USABLE = "usable"
    REDO = "redo"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """What one rule says.

    Attributes
    ----------
    rule
        Its name, as in docs/report.md.
    level
        Its judgement.
    text
        What was found, one sentence.
    advice
        What to do about it; empty where nothing is to be done.
    """

    rule: str
    level: Level
    text: str
    advice: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Whether a calibration can be used.

    Attributes
    ----------
    level
        The worst of the reasons.
    headline
        One sentence.
    reasons
        What every rule says, the worst first.
    next_steps
        What to do now, the most pressing first.
    """

    level: Level
    headline: str
    reasons: tuple[Reason, ...]
    next_steps: tuple[str, ...]
