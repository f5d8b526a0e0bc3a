"""Advice on the next stops, computed from a drive's information, in place of rules of thumb."""

from collections.abc import Sequence
from dataclasses import replace
from math import degrees

from boxcal.calib.errors import CalibError
from boxcal.calib.planning.goal import worst
from boxcal.calib.planning.next_stops import NextStop, said, what_next
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level, Reason
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target

MENDED_BY_STOPS = ("stops", "straight", "heading", "turn", "camera-angle", "camera-place", "open")
"""Rules on how certain the quantities are: more stops help."""
_COUNT = "stops"
"""Rule on how many there are: what is computed comes beside the number that is wanted."""
_STOPS = 2


def calls_for_stops(reasons: Sequence[Reason]) -> bool:
    """Return whether any reason is one that more stops mend."""
    return any(r.rule in MENDED_BY_STOPS and r.level is not Level.GOOD and not r.because for r in reasons)


def advised(reasons: Sequence[Reason], advice: str) -> list[Reason]:
    """Return reasons whose advice is the computed one where more stops mend them; as they are without such."""
    if not advice:
        return list(reasons)
    return [
        replace(r, advice=f"{r.advice} {advice}" if r.rule == _COUNT else advice)
        if r.rule in MENDED_BY_STOPS and r.level is not Level.GOOD
        else r
        for r in reasons
    ]


def more_stops(calibration: Calibration, drives: Sequence[Correspondences], target: Target) -> str:
    """Return where to stop next and what that promises, in a sentence or two; empty where nothing can be computed."""
    try:
        stops = what_next(calibration, drives, target, count=_STOPS)
    except CalibError:  # no place for this camera on any floor, say: the rules' own advice stands
        return ""
    return sentence_of(stops) if stops else ""


def sentence_of(stops: Sequence[NextStop]) -> str:
    """Return the next stops in a sentence, with what they promise of the quantity furthest from its goal."""
    before = worst(stops[0].before)
    after = next(bar for bar in stops[-1].after if bar.name == before.name)
    return (
        f"Drive on from the last stop and stop {', then '.join(_place(stop) for stop in stops)}: that takes "
        f"'{before.label.lower()}' from {said(before)} into the range {stops[-1].promised(after)} (nine drives in "
        "ten). plan-drive --after gives more such stops."
    )


def _place(stop: NextStop) -> str:
    spin = ""
    if stop.whole_turns:
        spin = f" after a whole turn to the {'left' if stop.whole_turns > 0 else 'right'}"
    heading = (degrees(stop.heading) + 180) % 360 - 180
    return (
        f"at x {stop.x:+.2f} m, y {stop.y:+.2f} m of the box, heading {heading:.0f}\N{DEGREE SIGN} from face 0's "
        f"normal{spin}"
    )
