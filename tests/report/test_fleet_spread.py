"""What hardware revisions explain of a fleet's spread is told where it is more than chance."""

import numpy as np

from boxcal.calib.report.fleet_spread import spread_rows
from boxcal.calib.report.fleet_tables import PARAMETERS

DASH = "\N{EN DASH}"


def _explained(rng: np.random.Generator, robots: int, apart: float) -> list[str]:
    """Return what is said of every parameter, of two revisions whose first parameter alone lies apart."""
    values = rng.standard_normal((2 * robots, len(PARAMETERS)))
    values[robots:, 0] += apart
    groups = ["A"] * robots + ["B"] * robots
    return [row.hardware for row in spread_rows(values, np.full(values.shape, 0.2), groups)]


def test_revisions_that_do_not_differ_explain_nothing_however_small_they_are() -> None:
    """Five fleets in a hundred name some parameter: of 20 not more than 5 (p = 3e-4)."""
    for robots in (3, 6):
        rng = np.random.default_rng(robots)
        named = sum(any(said not in {"", DASH} for said in _explained(rng, robots, 0.0)) for _ in range(20))
        assert named <= 5


def test_revisions_that_differ_explain_their_part() -> None:
    """Two groups 6 sigmas apart: of a variance of 1 + 9 nine tenths lie between them."""
    said = _explained(np.random.default_rng(1), 20, 6.0)
    assert 85 < int(said[0]) <= 97
    assert set(said[1:]) == {DASH}
