"""A verdict as lines of text: for the terminal, and for the head of every file that is made from a result."""

import textwrap
from collections.abc import Collection, Iterator

from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level, Verdict

WIDTH = 80
"""Columns of a terminal that nobody widened."""
_MARK = {Level.GOOD: "GOOD", Level.USABLE: "USABLE", Level.REDO: "REDO"}
_REPEATED = ("leaving out single stops", "camera model chosen")
"""Notes that the verdict gives as reasons, or that matter to who reads calibration.json."""
_LABEL = {"why": "why: ", "hence": "  so: ", "do": "do: ", "note": "note: ", "not checked": "not checked: "}


def judgement(robot: str, verdict: Verdict, *, width: int = WIDTH, given: Collection[str] = ()) -> str:
    """Return a verdict with its reasons, causes first, and what to do, wrapped to a width, without repeated notes."""
    lines = wrapped(f"{robot}: ", f"{_MARK[verdict.level]} - {verdict.headline} ({verdict.count})", width)
    for label, text in verdict.lines():
        if label == "note" and text in given:
            continue
        if label != "do" or verdict.level is not Level.GOOD:
            lines += wrapped(f"  {_LABEL[label]}", text, width)
    return "\n".join(lines)


def verdict_notes(calibration: Calibration) -> Iterator[str]:
    """Yield the notes of a result's verdict."""
    if calibration.verdict is not None:
        yield from (text for label, text in calibration.verdict.lines() if label == "note")


def own_notes(calibration: Calibration) -> Iterator[str]:
    """Yield the notes of a result that its verdict does not say already."""
    legs = calibration.detail.flagged_legs if calibration.detail else ()
    given = {leg.text for leg in legs} | {finding.text for finding in calibration.findings}
    given = given if calibration.verdict else set()
    for note in calibration.notes:
        if note not in given and not note.startswith(_REPEATED):
            yield note


def header_lines(verdict: Verdict | None) -> Iterator[str]:
    """Yield the lines that head a file made from a result: whether it may be used, and why not."""
    if verdict is None:
        yield "verdict: not judged"
        return
    yield f"verdict: {_MARK[verdict.level]} - {verdict.headline}"
    if verdict.level is Level.GOOD:
        return
    for cause in verdict.causes:
        yield f"why: {cause.text}"
    for step in verdict.next_steps:
        yield f"do: {step}"


def wrapped(label: str, text: str, width: int = WIDTH) -> list[str]:
    """Return lines of a text after a label, wrapped to a width."""
    return textwrap.wrap(
        text, max(width, 40), initial_indent=label, subsequent_indent=" " * min(len(label), 8), break_on_hyphens=False
    )
