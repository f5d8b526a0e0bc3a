"""The report of a fleet: which robots can be used, how alike they are, and what became of those that failed."""

from collections.abc import Collection, Mapping, Sequence
from math import isfinite

from boxcal.calib.assessment.verdict import verdict
from boxcal.calib.report.fleet_tables import (
    ENOUGH,
    PARAMETERS,
    odd_list,
    odd_ones,
    parameter_table,
    robot_row,
    shape_rows,
    spread_rows,
    steps,
)
from boxcal.calib.report.page import page, readable_time
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
    odd = odd_ones(values, sigmas)
    order = sorted(range(len(results)), key=lambda i: -verdicts[i].level.rank)
    return page(
        "fleet.html",
        scripts=("draw.js", "fleet.js"),
        data={
            "robots": [c.robot for c in results],
            "panels": [
                {
                    "key": p.key,
                    "name": p.name,
                    "unit": p.unit,
                    "value": [_number(v * p.scale) for v in values[:, k]],
                    "sigma": [_number(s * p.scale) for s in sigmas[:, k]],
                    "odd": odd[:, k].tolist(),
                }
                for k, p in enumerate(PARAMETERS)
            ],
        },
        counts={level.value: sum(v.level is level for v in verdicts) for level in Level},
        robots=[
            robot_row(
                results[i],
                verdicts[i],
                values[i],
                odd[i],
                stale.get(results[i].robot, ""),
                linked=results[i].robot not in without_page,
            )
            for i in order
        ],
        headings=PARAMETERS,
        failures=failures,
        spread=spread_rows(values, sigmas) if len(results) > 1 else [],
        odd=odd_list(results, values, odd, without_page),
        steps=steps(results, verdicts),
        shape=shape_rows(results),
        names=[c.robot for c in results],
        enough=ENOUGH,
        version=results[0].provenance.version if results else "",
        created=readable_time(max((c.provenance.created for c in results), default="")),
    )


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if isfinite(value) else None
