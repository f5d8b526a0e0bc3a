"""The command ``fleet-calibrate``."""

import argparse
import os
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING

from boxcal.calib.fleet.interrupts import interrupts_held, interrupts_remembered
from boxcal.calib.fleet.options import options
from boxcal.calib.fleet.telling import tell as say
from boxcal.target.errors import one_line

if TYPE_CHECKING:
    from pathlib import Path

    from boxcal.calib.fleet.engine.calls import Engine
    from boxcal.calib.fleet.joint_box import Refined
    from boxcal.calib.fleet.results_place import ResultsPlace
    from boxcal.calib.one_robot.log_identity import FileState
    from boxcal.calib.settings import Job, Outcome
    from boxcal.target.errors import BoxcalError

INTERRUPTED = 130
"""Exit status of Ctrl-C, as shells have it."""


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate robots from their logs; returns the exit status."""
    args = options().parse_args(argv)
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        with interrupts_remembered() as stop_if_asked:
            command = one_line(shlex.join(["fleet-calibrate", *words]))
            return _watch(args, command, stop_if_asked) if args.watch else _run(args, command, stop_if_asked)[0]
    except BrokenPipeError:  # whoever read the output has closed it (| head); all files are written
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        say("fleet-calibrate: interrupted")
        return INTERRUPTED


def _watch(args: argparse.Namespace, command: str, stop_if_asked: Callable[[], None]) -> int:
    """Calibrate logs as they arrive, until Ctrl-C between two of them; returns the exit status."""
    from boxcal.calib.fleet.watching import watch
    from boxcal.target.errors import BoxcalError

    interrupted = False

    def calibrate(logs: "list[Path]", tell: Callable[[str], None]) -> "list[Path] | None":
        nonlocal interrupted
        args.logs = logs
        status, left = _run(args, command, stop_if_asked, tell)
        interrupted = status == INTERRUPTED
        return None if interrupted else left

    try:
        watch(list(args.logs), calibrate, say)
    except BoxcalError as error:
        say(f"fleet-calibrate: {error}")
        return 2
    except KeyboardInterrupt:
        say("fleet-calibrate: no longer watching")
    return INTERRUPTED if interrupted else 0


def _run(
    args: argparse.Namespace,
    command: str,
    stop_if_asked: Callable[[], None],
    tell: Callable[[str], None] | None = None,
) -> "tuple[int, list[Path]]":
    """Calibrate robots; returns the exit status, and the logs that were not reached.

    What prevents all of them is reported by ``tell`` (:func:`say` if not given).
    """
    tell, logs = tell or say, list(args.logs)
    if not args.quiet:  # before what takes a second to load
        tell(f"fleet-calibrate: {len(logs)} log{'s' if len(logs) > 1 else ''}, starting ...")
    from boxcal.calib.fleet.engine.chosen import chosen_engine
    from boxcal.calib.fleet.results_place import results_place
    from boxcal.calib.fleet.run_record import Run
    from boxcal.calib.fleet.store import results_now
    from boxcal.calib.history_store.record import check_store
    from boxcal.target.errors import BoxcalError

    with ExitStack() as open_places:
        try:
            place = open_places.enter_context(results_place(args.out))
            jobs, box = _jobs(args, command, place)
            unreachable = check_store(args.store)
            outcomes, why = _kept(args, jobs, place)
            waiting = [job for job in jobs if job.robot in why]
            engine, remarks = chosen_engine(args, len(jobs if args.joint_box else waiting))
            open_places.enter_context(engine)
        except BoxcalError as error:
            tell(f"fleet-calibrate: {error}")
            return 2, logs
        if unreachable:
            tell(f"fleet-calibrate: {unreachable}")
        kept = f"{len(outcomes)} of {len(jobs)} robots are unchanged and kept (--force does them again)"
        for line in [] if args.quiet else [box, *remarks, *([f"fleet-calibrate: {kept}"] if outcomes else [])]:
            say(line)
        stop_if_asked()
        run = Run(command=command, engine=remarks[0] if remarks else "this machine", jobs=jobs, why=why)
        before = results_now(jobs)
        ended = _work(args, waiting, outcomes, engine, stop_if_asked)
        whole = len(outcomes) == len(jobs)
        together = _refine(args, outcomes, engine, place) if whole and args.joint_box else None
        whole = whole and (together is not None or not args.joint_box)
        with interrupts_held():  # what is finished is put down, however often Ctrl-C is pressed
            from boxcal.calib.fleet.conclude import conclude

            early = "" if whole else str(ended or "interrupted")
            status = conclude(args, run, outcomes, place, early)
            if together is not None:
                print("\n" + "\n".join(together.lines))
                status = max(status, 1) if together.failed else status
        if ended is not None:
            tell(f"fleet-calibrate: {ended}")
            reached = {outcome.job.robot for outcome in outcomes}
            return max(status, 1), [log for job in jobs if job.robot not in reached for log in job.logs]
        return status if whole else _interrupted(jobs, outcomes, before), []


def _kept(args: argparse.Namespace, jobs: "list[Job]", place: "ResultsPlace") -> "tuple[list[Outcome], dict[str, str]]":
    """Return the outcomes of robots that need not be done again, and why each other one is done."""
    from boxcal.calib.fleet.resume import unchanged

    if args.force:
        return [], dict.fromkeys((job.robot for job in jobs), "--force")
    return unchanged(jobs, place, joint=args.joint_box)


def _work(
    args: argparse.Namespace,
    waiting: "list[Job]",
    outcomes: "list[Outcome]",
    engine: "Engine",
    stop_if_asked: Callable[[], None],
) -> "BoxcalError | None":
    """Calibrate whoever waits and append what comes of it, until Ctrl-C; return what ended the engine, if anything."""
    from boxcal.calib.console.progress import make_progress
    from boxcal.calib.errors import CalibError
    from boxcal.calib.fleet.batch import calibrate_fleet

    try:
        with (
            make_progress(len(waiting), quiet=args.quiet) as progress,
            closing(calibrate_fleet(waiting, engine=engine, progress=progress.stage)) as running,
        ):
            stop_if_asked()
            for outcome in running:
                outcomes.append(outcome)
                progress.done(outcome)
                stop_if_asked()
    except KeyboardInterrupt:
        return None
    except CalibError as error:
        return error
    return None


def _refine(
    args: argparse.Namespace, outcomes: "list[Outcome]", engine: "Engine", place: "ResultsPlace"
) -> "Refined | None":
    """Solve the box by all robots, and make their outcomes anew with it; None if Ctrl-C was pressed."""
    from boxcal.calib.fleet.engine.chosen import local_engine
    from boxcal.calib.fleet.joint_box import refine

    if not args.quiet:
        say(f"fleet-calibrate: solving the box by {len(outcomes)} robots together ...")
    try:
        with ExitStack() as opened:
            if not engine.sees_files:  # the robots' saved files lie here
                engine = opened.enter_context(local_engine(len(outcomes), workers=args.jobs, limit_s=args.time_limit))
            together = refine(outcomes, engine, place.folder, place.said)
    except KeyboardInterrupt:
        return None
    outcomes[:] = together.outcomes
    return together


def _jobs(args: argparse.Namespace, command: str, place: "ResultsPlace") -> "tuple[list[Job], str]":
    """Return what is to be done, with all that can be said against it said before the work, and which box it is."""
    from boxcal.calib.fleet.chosen_settings import chosen_settings
    from boxcal.calib.fleet.find_target import find_target
    from boxcal.calib.fleet.manifest import given_manifest, jobs_of, logs_of, one_target
    from boxcal.calib.fleet.plan import check_options, plan
    from boxcal.calib.fleet.store import check_folder

    rows = given_manifest(args, options())
    args.logs = logs_of(args.logs, rows)
    check_options(args)
    found = find_target(args.target or one_target(rows), args.logs)
    check_folder(place.folder, found.target)
    report = not args.no_report and _has_report()
    if rows:
        return jobs_of(rows, args, found.target, report=report, command=command), found.said
    settings = chosen_settings(args, found.target, report=report)
    jobs = plan(
        args.logs, target=found.target, settings=settings, out=args.out, command=command, same_robot=args.same_robot
    )
    return jobs, found.said


def _has_report() -> bool:
    """Return whether the extra ``report`` is installed; say so on stderr if not."""
    from importlib.util import find_spec

    if not all(find_spec(name) for name in ("jinja2", "xlsxwriter")):
        print("fleet-calibrate: no reports without the extra: pip install 'boxcal[report]'", file=sys.stderr)
        return False
    return True


def _interrupted(jobs: "list[Job]", outcomes: "list[Outcome]", before: "Mapping[str, FileState]") -> int:
    from boxcal.calib.fleet.store import results_now

    calibrated = [o.job.robot for o in outcomes if o.calibration is not None]
    written = [robot for robot, state in results_now(jobs).items() if before.get(robot) != state]
    done = list(dict.fromkeys([*written, *calibrated]))
    names = f" ({', '.join(done)})" if done else ""
    say(
        f"fleet-calibrate: interrupted; {len(done)} of {len(jobs)} robots were finished and are kept{names}; "
        "give the same command again for the rest"
    )
    return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
