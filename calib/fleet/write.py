"""Files about all robots of a folder: ``fleet.json``, ``fleet.csv``, ``fleet.xlsx``, ``fleet.html``.

Where robots have several cameras, ``fleet-cameras.csv`` and ``fleet-camera-pairs.csv`` are written too.
"""

from collections.abc import Collection, Sequence
from pathlib import Path

from boxcal.calib.exports.fleet_cameras import CAMERA_COLUMNS, PAIR_COLUMNS, TEXTS, camera_lines, pair_lines
from boxcal.calib.exports.fleet_csv import COLUMNS, columns_csv, each_row, fleet_csv
from boxcal.calib.exports.fleet_xlsx import Sheet, fleet_xlsx
from boxcal.calib.fleet.store import CAMERA_TABLES, FLEET, PAGES, Member, fleet_record
from boxcal.calib.report.fleet import fleet_report
from boxcal.calib.results.calibration import Calibration
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
    several = [c for c in results if c.rig is not None]
    more = _of_cameras(several)
    for sheet in more:
        write_atomically(out / CAMERA_TABLES[sheet.name], fleet_csv(sheet.rows, sheet.columns))
    for name in CAMERA_TABLES.values() if not more else ():
        (out / name).unlink(missing_ok=True)
    legend = {name: text for sheet in reversed(more) for name, text in sheet.columns.items()}
    write_atomically(out / "fleet-columns.csv", columns_csv({**COLUMNS, **legend, **COLUMNS}))
    if report:
        without_page = [c.robot for c in results if c.robot not in reported]
        failures = [m.error for m in members if m.error is not None]
        write_atomically(out / "fleet.html", fleet_report(results, failures, stale, without_page))
        write_atomically(out / "fleet.xlsx", fleet_xlsx(each_row(results, errors=errors, stale=stale), more))
    else:
        for name in PAGES:
            (out / name).unlink(missing_ok=True)
    write_pieces_atomically(out / FLEET, fleet_record(members, target, command))


def _of_cameras(several: Sequence[Calibration]) -> tuple[Sheet, ...]:
    """Return the tables of all cameras and of all pairs; none for a fleet whose robots have one camera."""
    if not several:
        return ()
    cameras, pairs = list(camera_lines(several)), list(pair_lines(several))
    return (
        Sheet(name="cameras", columns=CAMERA_COLUMNS, texts=TEXTS, rows=cameras),
        Sheet(name="camera pairs", columns=PAIR_COLUMNS, texts=TEXTS, rows=pairs),
    )
