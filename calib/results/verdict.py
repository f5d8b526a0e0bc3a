"""Verdict that a calibration carries: its level, reasons and next steps."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """GOOD: use it. USABLE: use it with care. REDO: do not use it."""

    GOOD = "good"
    USABLE = "usable"
    REDO = "redo"

    @property
    def rank(self) -> int:
        """0, 1, 2: the larger, the worse."""
        return (Level.GOOD, Level.USABLE, Level.REDO).index(self)


class Kind(StrEnum):
    """CHECK: something was judged. NOTE: something was solved for. UNCHECKED: something could not be judged."""

    CHECK = "check"
    NOTE = "note"
    UNCHECKED = "unchecked"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Judgement of one rule.

    Attributes
    ----------
    rule
        Its name, as in docs/report.md; of a named cause its name in the catalogue of explanations.
    level
        Its judgement; of a note or of what could not be judged it is good.
    text
        What was found, one sentence.
    advice
        What to do about it; empty where nothing is to be done.
    kind
        What kind of reason it is.
    because
        The rule of the cause that it follows from; empty for a cause, and for what is in order.
    """

    rule: str
    level: Level
    text: str
    advice: str = ""
    kind: Kind = Kind.CHECK
    because: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict on a calibration: good, usable or redo, with reasons.

    Attributes
    ----------
    level
        The worst of the reasons.
    headline
        One sentence.
    reasons
        Causes, the worst first and each followed by its consequences; then notes, what could not be checked, and what
        is in order.
    next_steps
        What to do now, the most pressing first.
    """

    level: Level
    headline: str
    reasons: tuple[Reason, ...]
    next_steps: tuple[str, ...]

    @property
    def causes(self) -> tuple[Reason, ...]:
        """Reasons that are causes, without those that follow from them."""
        return tuple(r for r in self.reasons if r.level is not Level.GOOD and not r.because)

    @property
    def notes(self) -> tuple[Reason, ...]:
        """Causes that were solved for, so that the result allows for them."""
        return tuple(r for r in self.reasons if r.kind is Kind.NOTE)

    @property
    def unchecked(self) -> tuple[Reason, ...]:
        """Checks that could not be made."""
        return tuple(r for r in self.reasons if r.kind is Kind.UNCHECKED)

    @property
    def passed(self) -> tuple[Reason, ...]:
        """Checks that found all well."""
        return tuple(r for r in self.reasons if r.kind is Kind.CHECK and r.level is Level.GOOD)

    @property
    def count(self) -> str:
        """Summary of the checks in words."""
        follow = sum(bool(r.because) for r in self.reasons)
        return "; ".join(
            part
            for part in (
                f"{len(self.passed)} checks passed",
                f"{len(self.causes)} did not" if self.causes else "",
                f"{follow} more follow{'s' if follow == 1 else ''} from {'it' if len(self.causes) == 1 else 'these'}"
                if follow
                else "",
                f"{len(self.unchecked)} could not be made" if self.unchecked else "",
            )
            if part
        )

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield the judgement as pairs of a label and a sentence: what every text of it says, in this order."""
        for reason in self.reasons:
            if reason.level is not Level.GOOD:
                yield "hence" if reason.because else "why", reason.text
        for step in self.next_steps:
            yield "do", step
        for note in self.notes:
            yield "note", note.text
        for reason in self.unchecked:
            yield "not checked", reason.text
