"""History of a fleet: every robot's changes, wear, scatter between sessions, and when to calibrate again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import sqrt

import numpy as np

from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.history.boxes import of_one_size
from boxcal.calib.history.channels import CHANNELS, EXTRINSICS, KEYS, Series, series_of
from boxcal.calib.history.drift import HORIZON, Trend, own_trend, shrunk, years_until
from boxcal.calib.history.monitor import LEVEL, Change, Watched, fleet_sizes, watch
from boxcal.calib.history.scatter import Scatter, Stretch, between_sessions, first_guess, own_factor
from boxcal.calib.history.session import Session
from boxcal.target.arrays import Array

FAR_M = 0.20
"""Position error after 10 m, m, up to which a calibration is good (docs/report.md): beyond it, calibrate again."""
_LEAST_DOF = 2
"""Degrees of freedom of the scatter between sessions below which nothing is called a change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """One quantity's change: before and after, in SI or relative, with its standard deviation."""

    channel: int
    size: float
    sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """A change of a robot, as it is reported to its owner.

    Attributes
    ----------
    change
        What was found.
    since, until, found
        Days of the last drive before it, of the first after it, and of the drive that revealed it.
    shifts
        The part's quantities that moved, the most certain first (of a drift: a year).
    turned, turned_sigma : rad
        Whole angle that a camera was turned by; zeros for others.
    other_box
        Whether the box was another one since then, of which too few robots determine the size: all lengths may follow
        it.
    """

    change: Change
    since: str
    until: str
    found: str
    shifts: tuple[Shift, ...]
    turned: float = 0.0
    turned_sigma: float = 0.0
    other_box: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotHistory:
    """History of one robot.

    Attributes
    ----------
    robot, hardware
        Its name and hardware revision.
    sessions
        In the order of time.
    series
        The same by channel.
    watched
        What a watch over them found.
    events
        Its reported changes.
    scatter : (J,)
        Standard deviation between sessions of this robot, by channel.
    trends
        Drift of both radii since the last change, by channel key (r, d, rL, rR).
    due
        Day by which to calibrate again; empty if the trend reaches no limit within five years.
    due_now
        Whether that day has come already by what one calibration leaves open.
    of_camera
        Whether this is the history of a further camera of a robot, whose wheels stand with the robot itself.
    """

    robot: str
    hardware: str
    sessions: tuple[Session, ...]
    series: Series
    watched: Watched
    events: tuple[Event, ...]
    scatter: Array
    trends: Mapping[str, Trend]
    due: str
    due_now: bool
    of_camera: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FleetHistory:
    """History of a fleet.

    Attributes
    ----------
    robots
        By name.
    scatter
        Between sessions, over the fleet.
    level
        False alarms a year and a fleet, at most.
    judged
        Whether there are enough sessions to know what chance does.
    """

    robots: tuple[RobotHistory, ...]
    scatter: Scatter
    level: float
    judged: bool


def fleet_history(sessions: Sequence[Session], *, level: float = LEVEL, far_m: float = FAR_M) -> FleetHistory:
    """Return the history of a fleet from all its sessions.

    The scatter between sessions is guessed first without regard to changes, changes are looked for, the scatter is
    estimated between them, and they are looked for again.

    Parameters
    ----------
    sessions
        Of all robots, in any order.
    level
        False alarms a year and a fleet.
    far_m : m
        Position error after 10 m that calls for a calibration.
    """
    by_robot: dict[str, list[Session]] = {}
    for s in sorted(sessions, key=lambda s: (s.t_ns, s.key)):
        by_robot.setdefault(s.robot, []).append(s)
    names = sorted(by_robot)
    fleet, unsure = of_one_size([series_of(by_robot[name]) for name in names], [by_robot[name] for name in names])
    starts = [float(s.years[0]) for s in fleet]
    sizes = [fleet_sizes(starts, s.years) for s in fleet]
    guess = np.nan_to_num(first_guess(fleet))
    pairs = sum(max(len(s.years) - 1, 0) for s in fleet)
    found = _look(fleet, guess, _prior(pairs), sizes, level)
    scatter = between_sessions(_stretches(fleet, found))
    component = np.nan_to_num(scatter.component)
    judged = bool(np.nanmax(scatter.dof, initial=0) >= _LEAST_DOF)
    found = _look(fleet, component, scatter.prior_dof, sizes, level if judged else 0.0)
    stretches = _stretches(fleet, found)
    trends = _trends(fleet, found, component)
    robots = []
    for i, name in enumerate(names):
        factors = np.array(
            [
                own_factor([s for s in own if s.robot == i], component[j], scatter.prior_dof, wears=CHANNELS[j].wears)
                for j, own in enumerate(stretches)
            ]
        )
        robots.append(
            _told(
                _Robot(
                    sessions=tuple(by_robot[name]), series=fleet[i], watched=found[i], trends=trends[i], unsure=unsure
                ),
                scatter=np.sqrt(factors * component),
                component=component,
                far_m=far_m,
            )
        )
    return FleetHistory(robots=tuple(robots), scatter=scatter, level=level, judged=judged)


def _prior(pairs: int) -> float:
    """Return the degrees of freedom of a first guess that rests on a number of differences of sessions."""
    return 1 / (1 / 20 + 1 / max(pairs, 1))


def _look(
    fleet: Sequence[Series], component: Array, prior_dof: float, sizes: Sequence[Array], level: float
) -> list[Watched]:
    level = max(level, 1e-300)
    return [watch(s, component, prior_dof, n, level=level) for s, n in zip(fleet, sizes, strict=True)]


def _stretches(fleet: Sequence[Series], found: Sequence[Watched]) -> list[list[Stretch]]:
    """Return, for each channel, the sessions of all robots cut at their changes, outliers left out."""
    out: list[list[Stretch]] = []
    for j, channel in enumerate(CHANNELS):
        own = []
        for i, (s, w) in enumerate(zip(fleet, found, strict=True)):
            cuts = sorted({c.onset for c in w.changes if c.group == channel.group})
            for a, b in zip([0, *cuts], [*cuts, len(s.years)], strict=True):
                known = np.isfinite(s.variances[a:b, j]) & ~w.odd[a:b, j]
                own.append(
                    Stretch(
                        robot=i,
                        years=s.years[a:b][known],
                        values=s.values[a:b, j][known],
                        variances=s.variances[a:b, j][known],
                    )
                )
        out.append(own)
    return out


def _trends(fleet: Sequence[Series], found: Sequence[Watched], component: Array) -> list[dict[str, Trend]]:
    out: list[dict[str, Trend]] = [{} for _ in fleet]
    for j, channel in enumerate(CHANNELS):
        if not channel.wears:
            continue
        own = [
            own_trend(
                s.years[w.start[j] :],
                s.values[w.start[j] :, j],
                np.where(w.odd[w.start[j] :, j], np.inf, s.variances[w.start[j] :, j] + component[j]),
            )
            for s, w in zip(fleet, found, strict=True)
        ]
        like = [t if w.sloped[j] else s for t, s, w in zip(own, shrunk(own), found, strict=True)]
        for robot, trend in zip(out, like, strict=True):
            robot[channel.key] = trend
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Robot:
    """One robot while its history is computed."""

    sessions: tuple[Session, ...]
    series: Series
    watched: Watched
    trends: Mapping[str, Trend]
    unsure: set[str]


def _told(robot: _Robot, *, scatter: Array, component: Array, far_m: float) -> RobotHistory:
    sessions, series, watched, trends = robot.sessions, robot.series, robot.watched, robot.trends
    r, d = KEYS.index("r"), KEYS.index("d")
    counting = [k for k, s in enumerate(sessions) if s.counts]
    last = counting[-1] if counting else len(sessions) - 1
    total = series.variances[last] + component
    years = years_until(
        trends["r"], trends["d"], (float(total[r]), float(total[d])), float(sessions[last].wheels[2]), far_m
    )
    told = [np.isfinite(np.diag(sessions[k].covariance)[WHEELS]).any() for k in counting]
    of_camera = bool(counting) and not any(told)
    day = datetime.fromtimestamp(sessions[last].t_ns / 1e9, UTC) + timedelta(days=365.25 * years)
    return RobotHistory(
        robot=series.robot,
        hardware=next((s.hardware for s in reversed(sessions) if s.hardware), ""),
        sessions=sessions,
        series=series,
        watched=watched,
        events=tuple(_event(c, robot, component) for c in watched.changes),
        scatter=scatter,
        trends=trends,
        due="" if years >= HORIZON or of_camera else day.date().isoformat(),
        due_now=years <= 0 and not of_camera,
        of_camera=of_camera,
    )


def _event(change: Change, robot: _Robot, component: Array) -> Event:
    """Return a change with the sizes of all quantities of its part, from the sessions up to the next one."""
    sessions, series, watched = robot.sessions, robot.series, robot.watched
    later = [c.onset for c in watched.changes if c.group == change.group and c.onset > change.onset]
    earlier = [c.onset for c in watched.changes if c.group == change.group and c.onset < change.onset]
    a, b = max(earlier, default=0), min(later, default=len(sessions))
    shifts = []
    for j, channel in enumerate(CHANNELS):
        if channel.group == change.group:
            shift = _shift(series, watched, j, (a, change.onset, b), component[j], drift=change.drift)
            if shift is not None and (channel.wears or not change.drift):
                shifts.append(shift)
    shifts.sort(key=lambda s: -abs(s.size) / s.sigma)
    turned, sigma = 0.0, 0.0
    if change.group == EXTRINSICS:
        turns = [s for s in shifts if CHANNELS[s.channel].key in {"rx", "ry", "rz"}]
        turned = sqrt(sum(s.size**2 for s in turns))
        sigma = sqrt(sum((s.size * s.sigma) ** 2 for s in turns)) / turned if turned > 0 else 0.0
    return Event(
        change=change,
        since=sessions[max(change.onset - 1, 0)].date,
        until=sessions[change.onset].date,
        found=sessions[change.found].date,
        shifts=tuple(shifts),
        turned=turned,
        turned_sigma=sigma,
        other_box=_other_box(change, robot),
    )


def _other_box(change: Change, robot: _Robot) -> bool:
    before, after = (robot.sessions[k].target for k in (max(change.onset - 1, 0), change.onset))
    return before != after and bool({before, after} & robot.unsure)


def _shift(
    series: Series, watched: Watched, j: int, cut: tuple[int, int, int], component: float, *, drift: bool
) -> Shift | None:
    a, onset, b = cut
    variances = np.where(watched.odd[:, j], np.inf, series.variances[:, j] + component)
    if drift:
        t = own_trend(
            series.years[max(onset - 1, a) : b],
            series.values[max(onset - 1, a) : b, j],
            variances[max(onset - 1, a) : b],
        )
        return Shift(channel=j, size=t.rate, sigma=t.sigma) if np.isfinite(t.sigma) else None
    means = []
    for part in (slice(a, onset), slice(onset, b)):
        w = np.where(np.isfinite(variances[part]), 1 / np.maximum(variances[part], 1e-300), 0.0)
        total = float(np.sum(w))
        if total <= 0:
            return None
        means.append((float(np.sum(w * series.values[part, j])) / total, 1 / total))
    (before, v0), (after, v1) = means
    return Shift(channel=j, size=after - before, sigma=sqrt(v0 + v1))
