"""Files about all robots of a folder: ``fleet.json``, ``fleet.csv``, ``fleet.xlsx``, ``fleet.html``."""

from collections.abc import Collection, Sequence
from pathlib import Path

from boxcal.calib.exports.fleet_csv import columns_csv, each_row, fleet_csv
from boxcal.calib.exports.fleet_xlsx import fleet_xlsx
from boxcal.calib.fleet.store import FLEET, PAGES, Member, fleet_record
from boxcal.calib.report.fleet import fleet_report
from boxcal.target.box import Target
from boxcal.target.files.atomic_write import write_atomically, write_pieces_atomically

FAILED = "FAILED.txt"
"""Stands in the folder of a robot whose last log gave no calibration, beside what an earlier one gave."""


def write_fleet(
    out: Path, members: Sequence[Member], target: Target, *, command: str, report: bool, reported: Collection[str]
) -> None:
    """Write the files about a folder's robots.

    Parameters
    ----------
    out
        The folder.
    members
        Its robots, in the order in which they are shown.
    target
        The box that they drove around.
    command
        The command line.
    report
        Whether to write ``fleet.html`` and ``fleet.xlsx`` too: they need the extra ``report``. Else those of an
        earlier run are removed.
    reported
        Robots that have a report of their own, to which ``fleet.html`` links.

    Raises
    ------
    OSError
        As the file system does.
    """
    results = [m.calibration for m in members if m.calibration is not None]
    errors = {m.robot: str(m.error) for m in members if m.error is not None}
    stale = {m.robot: m.stale for m in members if m.stale}
    for m in members:
        if m.error is not None and m.calibration is not None:
            text = f"{m.error}\nThe files beside this one are of an earlier log ({m.calibration.provenance.created}).\n"
            write_atomically(out / m.robot / FAILED, text.encode())
        elif m.error is None:
            (out / m.robot / FAILED).unlink(missing_ok=True)
    write_atomically(out / "fleet.csv", fleet_csv(each_row(results, errors=errors, stale=stale)))
    write_atomically(out / "fleet-columns.csv", columns_csv())
    if report:
        without_page = [c.robot for c in results if c.robot not in reported]
        failures = [m.error for m in members if m.error is not None]
        write_atomically(out / "fleet.html", fleet_report(results, failures, stale, without_page))
        write_atomically(out / "fleet.xlsx", fleet_xlsx(each_row(results, errors=errors, stale=stale)))
    else:
        for name in PAGES:
            (out / name).unlink(missing_ok=True)
    write_pieces_atomically(out / FLEET, fleet_record(members, target, command))
