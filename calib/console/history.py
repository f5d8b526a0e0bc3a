"""History of robots in words and tables."""

from math import degrees, isfinite

from boxcal.calib.console.tables import shortened, table
from boxcal.calib.history.channels import CHANNELS, EXTRINSICS, KEYS
from boxcal.calib.history.drift import HORIZON, Trend
from boxcal.calib.history.fleet_history import Event, FleetHistory, RobotHistory, Shift
from boxcal.detect.log.safe_text import printable

_REPORTED_SIGMAS = 3.0
"""Standard deviations from which on a further value of a changed part is named."""
_MINUS = "\N{MINUS SIGN}"


def event_text(event: Event) -> str:
    """Return a change of a robot as its owner reads it: what, by how much, since when."""
    text = _what(event)
    if event.other_box:
        text += (
            "; the box is another one since, or was measured anew, which changes all lengths alike: look there first"
        )
    return text


def _what(event: Event) -> str:
    main = event.shifts[0] if event.shifts else None
    if main is None:
        return f"{event.change.group}: changed"
    if event.change.drift:
        return (
            f"{_name(main)}: drift of {_said(main)} a year since {event.until} (detected by the drive of {event.found})"
        )
    if event.change.group == EXTRINSICS:
        parts = []
        if _turned(event):
            parts.append(f"turned by {degrees(event.turned):.2f}° ± {degrees(event.turned_sigma):.2f}°")
        if moved := _moved(event):
            parts.append("moved " + ", ".join(f"{_name(s).removeprefix('camera ')} by {_said(s)}" for s in moved))
        what = f"camera {', '.join(parts)}" if parts else f"{_name(main)} {_said(main)}"
    else:
        others = [s for s in event.shifts if CHANNELS[s.channel].watched and abs(s.size) > _REPORTED_SIGMAS * s.sigma]
        what = "; ".join(f"{_name(s)} {_said(s)}" for s in (others or [main]))
    return f"{what}, between {event.since} and {event.until} (detected by the drive of {event.found})"


def _turned(event: Event) -> bool:
    """Return whether a camera was turned beyond what is not known of it."""
    return event.turned > _REPORTED_SIGMAS * event.turned_sigma


def _moved(event: Event) -> list[Shift]:
    return [s for s in event.shifts if CHANNELS[s.channel].unit == "mm" and abs(s.size) > _REPORTED_SIGMAS * s.sigma]


def short_event(event: Event) -> str:
    """Return a change in a few words."""
    if event.change.drift:
        return f"drift {_said(event.shifts[0])}/yr" if event.shifts else "drift"
    if event.change.group == EXTRINSICS:
        how = f" {degrees(event.turned):.2f}°" if _turned(event) else " moved" if _moved(event) else ""
        return f"camera{how} on {event.until}"
    return f"{event.change.group} on {event.until}"


def pending_text(group: str) -> str:
    """Return what a last session that differs alone calls for."""
    return f"{group}: the last drive differs beyond chance; drive once more to tell a change from a bad drive"


def drift_text(trend: Trend) -> str:
    """Return a drift in percent a year with its sigma; empty if nothing is known of it."""
    if not isfinite(trend.rate) or not isfinite(trend.sigma):
        return ""
    return f"{100 * trend.rate:+.2f} ± {100 * trend.sigma:.2f}".replace("-", _MINUS)


def due_text(robot: RobotHistory) -> str:
    """Return by when to calibrate a robot again."""
    if robot.due_now:
        return "now"
    return robot.due or ("with its robot" if robot.of_camera else f"> {HORIZON:g} years")


def fleet_text(history: FleetHistory) -> str:
    """Return a fleet's history as a table, changes first, in full."""
    header = ["robot", "drives", "last", "drift L %/yr", "drift R %/yr", "again by", "changes"]
    rows, lines = [], []
    for r in history.robots:
        changes = [short_event(e) for e in r.events[-1:]] + (["drive again"] if r.watched.pending else [])
        rows.append(
            [
                shortened(printable(r.robot)),
                str(len(r.sessions)),
                r.sessions[-1].date,
                drift_text(r.trends["rL"]),
                drift_text(r.trends["rR"]),
                due_text(r),
                "; ".join(changes) or "none",
            ]
        )
        lines += [f"{printable(r.robot)}: {event_text(e)}" for e in r.events]
        lines += [f"{printable(r.robot)}: {pending_text(group)}" for group in r.watched.pending]
    scatter = history.scatter.component
    known = [
        f"{c.name} {scatter[j] ** 0.5 * c.scale:.2g} {c.unit}"
        for j, c in enumerate(CHANNELS)
        if c.key in {"rL", "rR", "b", "ry", "f"} and isfinite(scatter[j])
    ]
    end = [f"between drives, beyond what the calibrations claim: {', '.join(known)}"] if known else []
    end.append(
        f"changes are told at no more than {history.level:g} false alarms a year, all robots together"
        if history.judged
        else "too few drives to tell a change from chance: three of a robot, or two of each of several"
    )
    return "\n".join([table(header, rows), "", *lines, *([""] if lines else []), *end])


def robot_text(history: FleetHistory, robot: RobotHistory) -> str:
    """Return one robot's history: its drives, what changed, what is known of its drift."""
    header = ["drive", "date", "verdict", "rL mm", "rR mm", "b mm", "x mm", "y mm", "z mm", "fu px"]
    rows = [
        [
            s.key[:8],
            s.date,
            s.verdict or "-",
            *(f"{1e3 * v:.3f}" for v in (s.wheels[1], s.wheels[0])),
            f"{1e3 * s.wheels[2]:.2f}",
            *(f"{1e3 * v:.1f}" for v in s.T_body_cam[:3, 3]),
            f"{s.camera[0]:.2f}",
        ]
        for s in robot.sessions
    ]
    lines = [event_text(e) for e in robot.events]
    if not lines and not robot.watched.pending:
        lines = ["no change beyond chance" if history.judged else "too few drives yet to tell a change from chance"]
    lines += [pending_text(group) for group in robot.watched.pending]
    lines += [f"{s.key[:8]}: {note}" for s in robot.sessions for note in s.notes]
    for key, side in (("rL", "left"), ("rR", "right")):
        if drift := drift_text(robot.trends[key]):
            lines.append(f"{side} radius: {drift} % a year over {robot.trends[key].sessions} drives")
    scatter = robot.scatter
    if history.judged and isfinite(scatter[KEYS.index("rL")]):
        own = ", ".join(
            f"{c.name} {scatter[j] * c.scale:.2g} {c.unit}" for j, c in enumerate(CHANNELS) if not c.watched
        )
        lines.append(f"between its drives, beyond what the calibrations claim: {own}")
    lines.append(f"calibrate again by: {due_text(robot)}")
    return "\n".join([printable(robot.robot), "", table(header, rows), "", *lines])


def _name(s: Shift) -> str:
    return CHANNELS[s.channel].name


def _said(s: Shift) -> str:
    c = CHANNELS[s.channel]
    gap = "" if c.unit == "°" else " "
    return f"{s.size * c.scale:+.2g} ± {s.sigma * c.scale:.1g}{gap}{c.unit}".replace("-", _MINUS)
