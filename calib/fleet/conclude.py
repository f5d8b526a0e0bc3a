"""End of a run of ``fleet-calibrate``: what is about the whole folder is written, and results are printed."""

import argparse

from boxcal.calib.compare.ground_truth import compare, load_truth, truth_path, with_truth
from boxcal.calib.compare.text import errors_table
from boxcal.calib.console.summary import summary
from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.copies import said_of_copies
from boxcal.calib.fleet.results_place import ResultsPlace
from boxcal.calib.fleet.run_record import RUN, Run
from boxcal.calib.fleet.store import CAMERA_TABLES, natural, read_folder
from boxcal.calib.fleet.telling import tell
from boxcal.calib.fleet.write import write_fleet
from boxcal.calib.history_store.record import record
from boxcal.calib.report.fleet_tables import REPORT
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Outcome
from boxcal.target.errors import BoxcalError
from boxcal.target.files.atomic_write import write_atomically

NOT_GOOD = 3
"""Exit status of a verdict that is not good, with ``--strict``."""


def conclude(args: argparse.Namespace, run: Run, outcomes: list[Outcome], place: ResultsPlace, early: str) -> int:
    """Write what is about the whole folder, then print results, errors against truth and failures."""
    outcomes.sort(key=lambda o: natural(o.job.robot))
    whole = _write_fleet(place, run, outcomes, early)
    good = [o.calibration for o in outcomes if o.calibration is not None]
    whole = _record(args, good) and whole
    failed = [o for o in outcomes if o.calibration is None]
    if good:
        _print_results(place, good, [o.job.robot for o in failed])
    if args.truth:
        whole = _print_errors(outcomes) and whole
    for line in said_of_copies(good):
        tell(f"fleet-calibrate: {line}")
    for o in failed:
        tell(f"fleet-calibrate: {o.error}")
        if o.details:
            tell(o.details)
    if failed:
        tell(f"fleet-calibrate: {len(failed)} of {len(outcomes)} robots failed")
    if failed or not whole:
        return 1
    not_good = [c.robot for c in good if c.verdict is None or c.verdict.level != "good"]
    if args.strict and not_good:
        tell(f"fleet-calibrate: not good: {', '.join(not_good)} (--strict)")
        return NOT_GOOD
    return 0


def _write_fleet(place: ResultsPlace, run: Run, outcomes: list[Outcome], early: str) -> bool:
    """Write what is about all robots of the folder; return whether that worked."""
    job = outcomes[0].job if outcomes else run.jobs[0]
    try:
        members = read_folder(place.folder, job.target, outcomes)
        report = job.settings.report
        reported = place.with_file(REPORT) if report else ()
        write_fleet(place.folder, members, job.target, command=run.command, report=report, reported=reported)
        write_atomically(place.folder / RUN, run.record(outcomes, early))
        place.put_fleet()
    except BoxcalError as error:
        tell(f"fleet-calibrate: {error}")
        return False
    except OSError as error:
        tell(f"fleet-calibrate: {place.said}: {error.strerror or error}; give another folder with --out")
        return False
    return True


def _record(args: argparse.Namespace, calibrations: list[Calibration]) -> bool:
    """Put the results into the store, if there is one; return whether that worked."""
    try:
        for line in record(args.store, calibrations):
            tell(f"fleet-calibrate: {line}")
    except CalibError as error:
        tell(f"fleet-calibrate: {error}; the results are in their folder: robot-history import {args.out}")
        return False
    return True


def _print_results(place: ResultsPlace, results: list[Calibration], failed: list[str]) -> None:
    print(summary(results, failed=failed))
    more = "".join(
        f",\n         {place.said}/{name}" for name in CAMERA_TABLES.values() if (place.folder / name).exists()
    )
    print(f"\nwritten: {place.said}/<robot>/calibration.json and files for ROS and Kalibr")
    if (place.folder / "fleet.html").exists():
        print(f"fleet:   {place.said}/fleet.html, {place.said}/fleet.xlsx, {place.said}/fleet.csv{more}")
        print(f"reports: {place.said}/<robot>/report.html")
    else:
        print(f"fleet:   {place.said}/fleet.csv, {place.said}/fleet.json{more}")


def _print_errors(outcomes: list[Outcome]) -> bool:
    """Print how far every calibration is from its truth; return whether there was a truth for each."""
    errors, missing, whole = [], [], True
    for o in outcomes:
        if o.calibration is None:
            continue
        path = truth_path(o.job.logs[0])
        if not path.exists():
            missing.append(path)
            continue
        try:
            errors += [(c.robot, compare(c, truth)) for c, truth in with_truth(o.calibration, load_truth(path))]
        except CalibError as error:
            whole = False
            tell(f"fleet-calibrate: {error}")
    if errors:
        print("\n" + errors_table(errors))
    if missing:
        more = f" and {len(missing) - 1} more like it" if len(missing) > 1 else ""
        tell(f"fleet-calibrate: no truth: {missing[0]}{more} cannot be found; leave out --truth")
    return whole and not missing
