"""Printed results of a run: all of a few robots; of a large fleet, what needs somebody's attention."""

from collections import Counter
from collections.abc import Sequence

from boxcal.calib.console.cameras import cameras_table, of_further_cameras
from boxcal.calib.console.judgement import judgement, own_notes, verdict_notes, wrapped
from boxcal.calib.console.tables import MANY, results_tables, shortened, verdict_table
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level

_WORST_FIRST = (Level.REDO, Level.USABLE)
_NAMED = 4
"""Robots whose names stand before a note that they share; of more, their number."""


def summary(results: Sequence[Calibration], *, failed: Sequence[str] = ()) -> str:
    """Return the results of a run as text, in paragraphs.

    Of up to :data:`~boxcal.calib.console.tables.MANY` robots it has verdicts, reasons, notes and parameters. Of more it
    has the count of each verdict, and table and reasons of those that are not good, the worst first; the fleet's files
    have the rest.

    Parameters
    ----------
    results
        Calibrations, in the order in which they are to be shown.
    failed
        Names of the robots that have none.
    """
    if len(results) + len(failed) <= MANY:
        paragraphs = [verdict_table(results, failed=failed), _said(results), results_tables(results)]
        return "\n\n".join([*paragraphs, *filter(None, [cameras_table(results)])])
    attention = [c for level in _WORST_FIRST for c in results if _level(c) == level]
    shown, lost = attention[:MANY], failed[: max(0, MANY - len(attention))]
    paragraphs = [_counts(results, len(failed))]
    if shown or lost:
        paragraphs += [verdict_table(shown, failed=lost)]
    if shown:
        paragraphs += [_said(shown)]
    if more := len(attention) + len(failed) - len(shown) - len(lost):
        paragraphs += [f"and {more} more that {'is' if more == 1 else 'are'} not good; the fleet's files list all"]
    return "\n\n".join(paragraphs)


def shared_notes(results: Sequence[Calibration]) -> dict[tuple[str, ...], list[str]]:
    """Return the notes that several robots have in common, by the names of those robots, in the order given."""
    robots: dict[str, tuple[str, ...]] = {}
    for c in results:
        for note in (*verdict_notes(c), *own_notes(c)):
            robots[note] = (*robots.get(note, ()), c.robot)
    shared: dict[tuple[str, ...], list[str]] = {}
    for note, names in robots.items():
        if len(names) > 1:
            shared.setdefault(names, []).append(note)
    return shared


def _said(results: Sequence[Calibration]) -> str:
    """Return what is said of each robot, and after it, once, what is said of several."""
    shared, lines = shared_notes(results), []
    told = {note for notes in shared.values() for note in notes}
    for c in results:
        if c.verdict is not None:
            lines.append(judgement(c.robot, c.verdict, given=told))
        lines += [line for note in own_notes(c) if note not in told for line in wrapped("  ", note)]
        lines += of_further_cameras(c)
    for robots, notes in shared.items():
        lines += [f"{_names(robots, len(results))}:", *(line for note in notes for line in wrapped("  ", note))]
    return "\n".join(lines)


def _names(robots: Sequence[str], of: int) -> str:
    if len(robots) == of and of > 2:
        return f"all {of} robots"
    return ", ".join(map(shortened, robots)) if len(robots) <= _NAMED else f"{len(robots)} of these {of} robots"


def _counts(results: Sequence[Calibration], failed: int) -> str:
    of_level = Counter(map(_level, results))
    words = [f"{of_level[level]} {level}" for level in (Level.GOOD, Level.USABLE, Level.REDO) if of_level[level]]
    words += [f"{of_level['']} not judged"] if of_level[""] else []
    words += [f"{failed} FAILED"] if failed else []
    return f"{len(results) + failed} robots: {', '.join(words)}"


def _level(c: Calibration) -> str:
    return c.verdict.level if c.verdict is not None else ""
