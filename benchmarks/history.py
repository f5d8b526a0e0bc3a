"""What a fleet's history finds, and how often it cries wolf, on simulated years.

    python benchmarks/history.py --fleets 50 --changed 10 --seed 1

Fleets of robots are calibrated every week of a year and looked at every month, as the nightly run would, with all
that is known by then. Unchanged fleets count false flags. In changed ones both radii of one robot wear by 0.2 % over
the year, another's camera is knocked by 0.3 deg about an axis at random, and a third gets tyres that are 0.2 % smaller;
it is printed after how many sessions each was found. Of the wear that is counted from where a test could have found it
that knew its size, its onset and all scatters beforehand, at the same false-alarm rate (Wald's likelihood ratio).
"""

import argparse
import sys
from collections.abc import Iterable, Sequence

import numpy as np

from boxcal.calib.history.channels import EXTRINSICS, KEYS, WHEELS, series_of
from boxcal.calib.history.fleet_history import FleetHistory, fleet_history
from boxcal.calib.history.monitor import LEVEL
from boxcal.calib.history.session import Session
from boxcal.calib.simulate.years import Years, simulated_years
from boxcal.one_thread import one_thread
from boxcal.target.arrays import Array

WORN, KNOCKED, TYRES = 3, 7, 9


def looks(sessions: Sequence[Session], count: int) -> Iterable[FleetHistory]:
    """Yield what is said at a number of times, evenly over the sessions."""
    begin, end = sessions[0].t_ns, sessions[-1].t_ns + 1
    for look in range(1, count + 1):
        until = begin + (end - begin) * look / count
        yield fleet_history([s for s in sessions if s.t_ns < until])


def flags(history: FleetHistory) -> dict[tuple[str, str], int]:
    """Return the session that revealed each robot's first change, by robot and part."""
    out: dict[tuple[str, str], int] = {}
    for robot in history.robots:
        for change in robot.watched.changes:
            out.setdefault((robot.robot, change.group), change.found)
    return out


def oracle(sessions: Sequence[Session], asked: Years) -> int:
    """Return the session at which Wald's ratio of the wear, known but for whether it is there, counts."""
    own = series_of([s for s in sessions if s.robot == f"r{WORN:04d}"])
    r = KEYS.index("r")
    years = own.years - own.years[0]
    rate = asked.wear / (asked.months / 12)
    mean = rate * years
    w = 1 / (own.variances[:, r] * (1 + asked.scatter**2))
    limit = np.log(asked.robots * asked.months / 12 / LEVEL)
    for k in range(2, len(years) + 1):
        centred = mean[:k] - np.average(mean[:k], weights=w[:k])
        if float(np.sum(w[:k] * centred * (own.values[:k, r] - centred / 2))) >= limit:
            return k - 1
    return len(years)


def said(values: Array, missed: int) -> str:
    """Return median and worst of delays."""
    if not len(values):
        return f"never ({missed} missed)"
    return f"median {np.median(values):.0f}, worst {np.max(values):.0f}" + (f", {missed} missed" if missed else "")


@one_thread()
def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=50, help="unchanged")
    parser.add_argument("--changed", type=int, default=10, help="fleets with a worn, a knocked and a re-tyred robot")
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--sessions", type=int, default=52, help="of each robot in the year")
    parser.add_argument("--looks", type=int, default=12, help="times in the year that the history is judged")
    parser.add_argument("--scatter", type=float, default=1.5, help="between sessions, in a calibration's sigmas")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(argv)
    rng = np.random.default_rng(args.seed)
    plain = Years(robots=args.robots, sessions=args.sessions, scatter=args.scatter)
    print(
        f"{args.robots} robots, 12 months, {args.sessions} sessions each, looked at {args.looks} times; "
        f"scatter between sessions {args.scatter:g} sigmas; level {LEVEL:g} false flags a fleet and a year"
    )
    changed(args, plain, rng)
    false = [
        len({key for h in looks(simulated_years(plain, rng), args.looks) for key in flags(h)})
        for _ in range(args.fleets)
    ]
    print(
        f"unchanged: {sum(false)} false flags in {args.fleets} fleet-years ({args.fleets * LEVEL:g} allowed by the "
        "level)"
    )
    return 0


def changed(args: argparse.Namespace, plain: Years, rng: np.random.Generator) -> None:
    at = args.sessions * 3 // 5
    delays: dict[str, list[int]] = {"knocked": [], "tyres": [], "worn": [], "worn sessions": []}
    wear, false, missed = [], 0, {"knocked": 0, "tyres": 0, "worn": 0}
    for _ in range(args.changed):
        asked = Years(
            robots=plain.robots,
            sessions=plain.sessions,
            scatter=plain.scatter,
            worn=(WORN,),
            knocked={KNOCKED: at},
            tyres={TYRES: at},
        )
        sessions = simulated_years(asked, rng)
        found: dict[tuple[str, str], int] = {}
        for h in looks(sessions, args.looks):
            found = flags(h) | found
        best = oracle(sessions, asked)
        for name, robot, group, begin in (
            ("knocked", KNOCKED, EXTRINSICS, at - 1),
            ("tyres", TYRES, WHEELS, at - 1),
            ("worn", WORN, WHEELS, best),
        ):
            k = found.pop((f"r{robot:04d}", group), None)
            if k is None:
                missed[name] += 1
                continue
            delays[name].append(k - begin)
            if name == "worn":
                wear.append(asked.wear * k / asked.sessions)
        false += len(found)
    if args.changed:
        print(
            f"camera knocked by 0.3 deg: found after sessions: {said(np.array(delays['knocked']), missed['knocked'])}"
        )
        print(f"tyres 0.2 % smaller:       found after sessions: {said(np.array(delays['tyres']), missed['tyres'])}")
        print(
            f"wear of 0.2 % in the year: found after sessions: {said(np.array(delays['worn']), missed['worn'])}, "
            f"beyond what a test that knows all could tell; worn by {np.median(wear):.2%} then (worst {min(wear):.2%})"
            if wear
            else "wear of 0.2 % in the year: never found"
        )
        print(f"false flags on the other robots of {args.changed} changed fleets: {false}")


if __name__ == "__main__":
    sys.exit(main())
