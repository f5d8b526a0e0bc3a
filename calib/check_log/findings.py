"""Findings of a quick check, one line each."""

from collections.abc import Iterable
from dataclasses import dataclass

from boxcal.calib.results.verdict import Level
from boxcal.target.errors import BoxcalError

_WORDS = {Level.GOOD: "ok", Level.USABLE: "look", Level.REDO: "wrong"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFinding:
    """One thing that was found in a recording.

    Attributes
    ----------
    level
        Its weight: as it should be (good), to be looked at (usable), or wrong (redo).
    topic
        What it is about, in a word: ``camera``, ``wheels``, ``clock``, ``stops``, ``box``, ``sharpness``, ``light``,
        ``drive``, ``known`` or ``missing``; for programs.
    text
        What was found.
    advice
        What to do about it; empty where nothing is to be done.
    """

    level: Level
    topic: str
    text: str
    advice: str = ""

    @property
    def word(self) -> str:
        """The level in a word: ok, look or wrong."""
        return _WORDS[self.level]

    @property
    def line(self) -> str:
        """The finding in one line."""
        return f"{self.word:<5}  {self.topic:<9}  {self.text}" + (f" {self.advice}" if self.advice else "")


def fine(topic: str, text: str) -> LogFinding:
    """Return a finding that is as it should be."""
    return LogFinding(level=Level.GOOD, topic=topic, text=text)


def look(topic: str, text: str, advice: str = "") -> LogFinding:
    """Return a finding that deserves a look."""
    return LogFinding(level=Level.USABLE, topic=topic, text=text, advice=advice)


def wrong(topic: str, text: str, advice: str = "") -> LogFinding:
    """Return a finding that spoils the drive."""
    return LogFinding(level=Level.REDO, topic=topic, text=text, advice=advice)


def refused(topic: str, error: BoxcalError) -> LogFinding:
    """Return an error as a finding that spoils the drive: what was found, what was needed, and what to do."""
    what = error.found + (f"; {error.needed}" if error.needed else "")
    return wrong(topic, sentence(what), sentence(error.remedy or ""))


def sentence(text: str) -> str:
    """Return a text with a capital letter and a full stop."""
    return text[:1].upper() + text[1:] + ("" if not text or text.endswith(".") else ".")


def listed_stops(numbers: Iterable[int], most: int = 8) -> str:
    """Return numbers of stops from 0 as people count them: "stop 3", "stops 1, 4 and 5"."""
    shown = [str(n + 1) for n in numbers]
    if len(shown) == 1:
        return f"stop {shown[0]}"
    if len(shown) > most:
        return f"stops {', '.join(shown[:most])} and {len(shown) - most} more"
    return f"stops {', '.join(shown[:-1])} and {shown[-1]}"
