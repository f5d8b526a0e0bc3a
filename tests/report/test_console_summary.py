"""Printed results of a run: each robot of a few; of a large fleet, what needs attention."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from boxcal.calib.assessment.verdict import judge
from boxcal.calib.compare.ground_truth import Errors
from boxcal.calib.compare.text import errors_table
from boxcal.calib.console.summary import shared_notes, summary
from boxcal.calib.console.tables import MANY
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target

Named = Callable[[str], Calibration]


@pytest.fixture
def judged(calibrations: Callable[[str], Calibration], drives: Callable[[str], Correspondences]) -> Named:
    """Calibrations by name, with their verdicts and a note that the verdict does not say."""
    return lambda name: replace(
        calibrations(name),
        verdict=judge(calibrations(name), drives(name), make_target()),
        notes=("the wheels squeak",),
    )


def _robots(found: Calibration, count: int, first: int = 0) -> list[Calibration]:
    return [replace(found, robot=f"r{k:03d}") for k in range(first, first + count)]


def test_a_note_that_several_robots_share_is_printed_once(judged: Named) -> None:
    good = judged("good_drive")
    own = replace(good, robot="r003", notes=(*good.notes, "one bulb is dead"))
    text = summary([*_robots(good, 3), own])
    robots = ("r000", "r001", "r002", "r003")
    assert shared_notes([good]) == {}
    assert good.verdict is not None
    of_verdict = [note.text for note in good.verdict.notes]
    assert shared_notes([*_robots(good, 3), own]) == {robots: [*of_verdict, "the wheels squeak"]}
    shared = "All lengths are as certain as the print's own size"
    assert any(note.startswith(shared) for note in of_verdict)
    assert text.count(shared) == 1, "what all verdicts note alike, too"
    assert text.count("the wheels squeak") == 1
    assert f"\nall 4 robots:\n  {shared}" in text
    assert f"  note: {shared}" in summary([good]), "one robot's note stands with its verdict"
    assert "\n  one bulb is dead\n" in text
    assert all(f"{robot}: GOOD" in text for robot in robots), "each robot has its verdict"
    assert max(map(len, text.splitlines())) <= 80


def test_a_note_of_some_robots_names_them(judged: Named) -> None:
    good = judged("good_drive")
    plain = replace(good, notes=())
    two = [*_robots(good, 2), *_robots(plain, 1, 2)]
    assert "\nr000, r001:\n  the wheels squeak\n" in summary(two)
    assert "\n5 of these 6 robots:\n  the wheels squeak\n" in summary([*_robots(good, 5), *_robots(plain, 1, 5)])


def test_a_large_fleet_is_counted_and_only_what_is_not_good_is_shown(judged: Named) -> None:
    good, bad = judged("good_drive"), judged("wrong_print")
    assert bad.verdict is not None
    fleet = [*_robots(good, 150), *_robots(bad, 2, 150), *_robots(good, 47, 152)]
    text = summary(fleet, failed=["r199"])
    head, *_ = text.splitlines()
    assert head == f"200 robots: 197 good, 2 {bad.verdict.level}, 1 FAILED"
    for name in ("r150", "r151", "r199"):
        assert sum(line.startswith(f"{name} ") for line in text.splitlines()) == 1, "a line in the table"
    assert "r150: " in text, "why it is not good"
    assert "r000" not in text
    assert "wheels  " not in text, "parameters are in the fleet's files"


def test_of_many_bad_robots_the_rest_is_counted(judged: Named) -> None:
    text = summary(_robots(judged("wrong_print"), MANY + 7), failed=["lost"])
    assert text.endswith("and 8 more that are not good; the fleet's files list all")
    assert f"r{MANY - 1:03d}: " in text
    assert f"r{MANY:03d}" not in text


def test_a_fleet_without_faults_is_one_line(judged: Named) -> None:
    assert summary(_robots(judged("good_drive"), 300)) == "300 robots: 300 good"


def test_errors_of_a_large_fleet_are_summed_up() -> None:
    def errors(scale: float) -> Errors:
        return Errors(**{field.name: scale for field in fields(Errors)})

    few = [(f"r{k}", errors(0.01)) for k in range(MANY)]
    assert errors_table(few).count("\nr1 ") == 2, "one line a robot in each table"
    values = [0.001 * (-1) ** k for k in range(29)] + [-0.006]
    text = errors_table([(f"r{k}", errors(v)) for k, v in enumerate(values)])
    wheels, camera = text.split("\n\n")
    rms = 1e3 * float(np.sqrt(np.mean(np.square(values))))
    for found, header in ((wheels, "x mm"), (camera, "kr")):
        title, _, first, second = found.splitlines()
        assert title.startswith("error against truth")
        assert header in title
        assert first.startswith("rms of 30 ")
        assert second.startswith("largest ")
    assert f"{rms:+.2f}" in wheels.splitlines()[2]
    assert "-6.00" in wheels.splitlines()[3]
