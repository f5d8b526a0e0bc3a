"""Causes before consequences: which failed rules follow from which, so that one fault is reported once."""

from collections.abc import Sequence
from dataclasses import replace

from boxcal.calib.results.verdict import Kind, Level, Reason

_FIT = ("sharpness", "legs", "slip", "floor", "wheels", "corners", "fit", "held-out")
_CERTAINTY = ("open", "straight", "heading", "turn", "camera-angle", "camera-place")
FOLLOWS: dict[str, tuple[str, ...]] = {
    "print": (*_FIT, *_CERTAINTY, "misfit"),
    "box-size": (),
    "stops": ("moves", *_CERTAINTY),
    "around": (),
    "turned": ("moves", *_CERTAINTY),
    "moves": _CERTAINTY,
    "sharpness": ("corners", "camera-angle", "camera-place"),
    "floor": ("slip", "legs", "fit", "misfit", "held-out"),
    "wheels": ("slip", "legs"),
    "slip": ("straight", "heading", "turn", "camera-place", "held-out"),
    "legs": ("held-out",),
    "corners": ("fit",),
    "fit": ("misfit",),
    "misfit": ("held-out",),
    "uncertainty": (),
    "open": ("straight", "heading", "turn", "camera-angle", "camera-place"),
    "straight": ("heading",),
    "heading": (),
    "turn": (),
    "camera-angle": (),
    "camera-place": (),
    "held-out": (),
    "ruler": (),
    "direction": (),
}
"""What each rule explains of the others. Its order is that of causes: a rule follows only from one before it."""
_OF_A_CAUSE = (*_FIT, *_CERTAINTY, "print", "misfit", "moves")
"""What a cause of the catalogue of explanations explains: all but how the drive was laid out."""


def arrange(reasons: Sequence[Reason]) -> tuple[Reason, ...]:
    """Return reasons in the order in which they are reported: causes with their consequences, notes, the rest.

    Parameters
    ----------
    reasons
        What all rules say, in any order; causes of the catalogue have names that no rule has.
    """
    faults = sorted((r for r in reasons if r.level is not Level.GOOD), key=_place)
    folded: list[Reason] = []
    for fault in faults:
        cause = next((c for c in folded if not c.because and fault.rule in _explained(c.rule)), None)
        folded.append(replace(fault, because=cause.rule) if cause and cause.rule != fault.rule else fault)
    rules = dict.fromkeys(r.rule for r in folded if not r.because)
    groups = [[r for r in folded if rule == (r.because or r.rule)] for rule in rules]
    groups.sort(key=lambda group: -max(r.level.rank for r in group))
    fine = sorted((r for r in reasons if r.level is Level.GOOD), key=_place)
    return (
        *(r for group in groups for r in group),
        *(r for r in fine if r.kind is Kind.NOTE),
        *(r for r in fine if r.kind is Kind.UNCHECKED),
        *(r for r in fine if r.kind is Kind.CHECK),
    )


def _explained(rule: str) -> tuple[str, ...]:
    return FOLLOWS.get(rule, _OF_A_CAUSE)


def _place(reason: Reason) -> tuple[int, int]:
    """Return where a reason stands among the causes: those of the catalogue first, the worst before the others."""
    if reason.rule not in FOLLOWS:
        return -1, -reason.level.rank
    return list(FOLLOWS).index(reason.rule), 0
