"""The report of a fleet: which robots can be used, how alike they are, and what became of those that failed."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from boxcal.calib.assessment.verdict import verdict
from boxcal.calib.report.fleet_box import MOST_COLUMNS, shape_rows
from boxcal.calib.report.fleet_cameras import CameraTable, camera_table, pair_table
from boxcal.calib.report.fleet_data import fleet_data
from boxcal.calib.report.fleet_spread import group_table, spread_rows
from boxcal.calib.report.fleet_tables import (
    ENOUGH,
    PARAMETERS,
    OddOne,
    hardware_of,
    odd_list,
    outlying,
    parameter_table,
    robot_row,
    steps,
)
from boxcal.calib.report.page import ROWS, page, readable_time
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level
from boxcal.target.errors import BoxcalError


def fleet_report(
    results: Sequence[Calibration],
    failures: Sequence[BoxcalError],
    stale: Mapping[str, str] | None = None,
    without_page: Collection[str] = (),
) -> bytes:
    """Return the report of a fleet: one HTML file that needs nothing else.

    It links to ``<robot>/report.html`` beside it.

    Parameters
    ----------
    results
        The robots that were calibrated; one that does not carry a verdict is judged by itself.
    failures
        Why the others were not.
    stale
        Robot -> why its result is none of today: its last log failed, or the box was measured anew since.
    without_page
        Robots that have no report of their own, to which nothing links.

    Raises
    ------
    CalibError
        If the extra ``report`` is not installed.
    """
    stale = stale or {}
    verdicts = [c.verdict or verdict(c) for c in results]
    values, sigmas = parameter_table(results)
    groups = hardware_of(results)
    alike = _alike(results, groups)
    odd = outlying(values, sigmas, alike)
    cameras, pairs = camera_table(results, without_page), pair_table(results)
    several = {key: table for key, table in (("cameras", cameras), ("pairs", pairs)) if table is not None}
    order = sorted(range(len(results)), key=lambda i: -verdicts[i].level.rank)
    rows = [
        robot_row(c, v, values[i], odd[i], stale.get(c.robot, ""), linked=c.robot not in without_page)
        for i, (c, v) in enumerate(zip(results, verdicts, strict=True))
    ]
    return page(
        "fleet.html",
        scripts=("draw.js", "table.js", "plot.js", "fleet.js", "spread.js", *(("cameras.js",) if several else ())),
        data=fleet_data(rows, order, values, sigmas, odd) | {key: table.data for key, table in several.items()},
        counts={level.value: sum(v.level is level for v in verdicts) for level in Level},
        total=len(rows),
        robots=[rows[i] for i in order[:ROWS]],
        shown=ROWS,
        headings=PARAMETERS,
        failures=failures,
        spread=spread_rows(values, sigmas, groups) if len(results) > 1 else [],
        hardware=sorted({g for g in groups if g}),
        groups=group_table(values, sigmas, groups),
        odd=[*odd_list(results, values, odd, alike, without_page), *_further_odd(results, several.values())],
        several=several,
        steps=steps(results, verdicts),
        shape=shape_rows(results),
        names=[c.robot for c in results] if len(results) <= MOST_COLUMNS else ["Mean", "Robots", "Who disagrees"],
        enough=ENOUGH,
        version=results[0].provenance.version if results else "",
        created=readable_time(max((c.provenance.created for c in results), default="")),
    )


def _alike(results: Sequence[Calibration], hardware: Sequence[str]) -> list[str]:
    """Return which robots are compared: of one hardware revision, their results of the same camera."""
    first = ["" if c.rig is None else c.rig.names[0] for c in results]
    return [f"{revision}\n{camera}" for revision, camera in zip(hardware, first, strict=True)]


def _further_odd(results: Sequence[Calibration], tables: Iterable[CameraTable]) -> list[OddOne]:
    """Return outliers among cameras and pairs, without those of the robots' first cameras, which are listed already."""
    first = {(c.robot, c.rig.names[0]) for c in results if c.rig is not None}
    return [o for table in tables for o in table.odd if (o.robot, o.name.rpartition(", ")[0]) not in first]
