"""A plan as the terminal shows it."""

from collections.abc import Sequence

from boxcal.calib.plan_drive.instructions import taped_stops
from boxcal.calib.planning.baseline import Baseline
from boxcal.calib.planning.goal import Bar
from boxcal.calib.planning.next_stops import NextStop, said
from boxcal.calib.planning.plan import DrivePlan


def plan_text(plan: DrivePlan, others: Sequence[Baseline] = ()) -> str:
    """Return a plan's stops, what it promises, and how other drives of as many stops would do."""
    lines = [
        f"{len(plan.stops)} stops, {plan.length:.1f} m, about {plan.seconds / 60:.1f} minutes"
        + ("" if plan.reached else "; not all goals are reached"),
        "",
        "stop   x m    y m    arrow  tags  faces  drive",
    ]
    for taped, stop in zip(taped_stops(plan), plan.stops, strict=True):
        faces = " ".join(str(f) for f in stop.faces)
        lines.append(
            f"{taped.number:>4} {stop.pose[0]:+6.2f} {stop.pose[1]:+6.2f} {taped.heading_deg:+6.0f}\N{DEGREE SIGN}"
            f"  {stop.tags:>4}  {faces:<5}  {taped.drive}"
        )
    names = ["this plan", *(other.name for other in others)]
    columns = [[bar.value for bar in plan.bars], *(list(other.values) for other in others)]
    lines += ["", f"{'one standard deviation':<36}{'goal':>9}" + "".join(f"{name:>16}" for name in names)]
    for k, bar in enumerate(plan.bars):
        cells = "".join(f"{said(_of(bar, column[k])):>16}" for column in columns)
        lines.append(f"{bar.label:<36}{said(_of(bar, bar.goal)):>9}{cells}")
    lines += ["", f"promised for {plan.assumptions.said} (--slip, --corner-px)"]
    return "\n".join(lines)


def _of(bar: Bar, value: float) -> Bar:
    return Bar(name=bar.name, label=bar.label, unit=bar.unit, value=value, goal=bar.goal)


def next_text(stops: Sequence[NextStop]) -> str:
    """Return the next stops, each with all that it promises, as the ranges of nine drives in ten."""
    lines = []
    for number, stop in enumerate(stops, 1):
        lines.append(f"{number}. {stop.text}")
        lines += [
            f"     {before.label:<36}{said(before):>9} -> {stop.promised(after)}"
            for before, after in zip(stop.before, stop.after, strict=True)
        ]
        lines.append(f"     reads {stop.tags} tags of faces {', '.join(map(str, stop.faces))}")
    lines += [
        "",
        "each quantity is found in its range in nine drives of ten; the fewer legs so far, the less is the slip known",
    ]
    return "\n".join(lines)
