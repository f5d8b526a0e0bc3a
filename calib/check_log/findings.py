"""Findings of a quick check, one line each."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Grade(StrEnum):
    """Weight of a finding: as it should be, worth a look, or wrong."""

    FINE = "ok"
    LOOK = "look"
    WRONG = "wrong"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFinding:
    """One thing that was found in a recording.

    Attributes
    ----------
    grade
        Its weight.
    topic
        What it is about, in a word: ``camera``, ``wheels``, ``clock``, ``stops``, ``box``, ``sharpness``, ``light``,
        ``drive``, ``known`` or ``missing``; for programs.
    text
        What was found.
    advice
        What to do about it; empty where nothing is to be done.
    """

    grade: Grade
    topic: str
    text: str
    advice: str = ""

    @property
    def line(self) -> str:
        """The finding in one line."""
        return f"{self.grade:<5}  {self.topic:<9}  {self.text}" + (f" {self.advice}" if self.advice else "")


def fine(topic: str, text: str) -> LogFinding:
    """Return a finding that is as it should be."""
    return LogFinding(grade=Grade.FINE, topic=topic, text=text)


def look(topic: str, text: str, advice: str = "") -> LogFinding:
    """Return a finding that is worth a look."""
    return LogFinding(grade=Grade.LOOK, topic=topic, text=text, advice=advice)


def wrong(topic: str, text: str, advice: str = "") -> LogFinding:
    """Return a finding that spoils the drive."""
    return LogFinding(grade=Grade.WRONG, topic=topic, text=text, advice=advice)


def listed_stops(numbers: Iterable[int], most: int = 8) -> str:
    """Return numbers of stops from 0 as people count them: "stop 3", "stops 1, 4 and 5"."""
    shown = [str(n + 1) for n in numbers]
    if len(shown) == 1:
        return f"stop {shown[0]}"
    if len(shown) > most:
        return f"stops {', '.join(shown[:most])} and {len(shown) - most} more"
    return f"stops {', '.join(shown[:-1])} and {shown[-1]}"
