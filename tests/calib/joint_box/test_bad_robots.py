"""Robots that are lost, do not follow, or come twice cost the others nothing, and nothing wrong is kept of them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import TARGET, drive_of, hand_made_box

from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.batch import calibrate_fleet
from boxcal.calib.fleet.engine.here import ThisProcess
from boxcal.calib.fleet.joint_box import REFINED, refine
from boxcal.calib.joint_box.api import refine_box
from boxcal.calib.joint_box.block import Block
from boxcal.calib.joint_box.one_of_many import Member, Part, begin, calibrated
from boxcal.calib.joint_box.robots import Robots
from boxcal.calib.joint_box.rounds import join
from boxcal.calib.joint_box.shape_prior import ShapePrior, shape_prior
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.results.fingerprint import JOINT
from boxcal.calib.results.json_format import load_calibration
from boxcal.calib.settings import Job, Outcome, Settings
from boxcal.detect.correspondences import Correspondences

Work = Callable[..., Any]


@pytest.fixture(scope="module")
def prior() -> ShapePrior:
    return shape_prior(EstimateOptions(target=TARGET))


@pytest.fixture(scope="module")
def drives() -> dict[str, Correspondences]:
    return {f"r{k}": drive_of(k, hand_made_box(0)).seen for k in range(3)}


def _members(names: Sequence[str]) -> list[Member]:
    return [
        Member(job=Job(robot=n, logs=(Path(n),), target=TARGET, settings=Settings(report=False), out=None))
        for n in names
    ]


def _part(prior: ShapePrior, seed: int, drive: str) -> Part:
    rng, m = np.random.default_rng([1, seed]), len(prior.names)
    J = 1e4 * rng.standard_normal((2 * m, m))
    return Part(block=Block(about=np.zeros(m), information=J.T @ J, score=np.zeros(m)), drives=(drive,))


class _Spoken:
    """Robots that answer as they are told to: each round's answers in a list of their own."""

    def __init__(self, *rounds: list[Part | None]) -> None:
        self.rounds = list(rounds)

    def __call__(self, _work: Work, *_each: Iterable[Any]) -> list[Part | None]:
        return self.rounds.pop(0) if len(self.rounds) > 1 else self.rounds[0]


def test_a_robot_that_does_not_follow_once_is_not_taken_for_settled(prior: ShapePrior) -> None:
    parts: list[Part | None] = [_part(prior, k, f"drive {k}") for k in range(3)]
    run = _Spoken(parts, [parts[0], None, parts[2]], parts)
    robots = Robots(_members(["a", "b", "c"]), prior, run)
    joined = join(robots.blocks, prior, robots.ask, components=prior.usual)
    assert joined.converged
    assert joined.rounds == 2
    assert robots.names == ["a", "b", "c"]


def test_a_robot_that_does_not_follow_twice_takes_no_part_and_the_others_settle(prior: ShapePrior) -> None:
    parts: list[Part | None] = [_part(prior, k, f"drive {k}") for k in range(3)]
    run = _Spoken(parts, [parts[0], None, parts[2]], [parts[0], replace(_part(prior, 1, ""), block=None), parts[2]],
                  [parts[0], parts[2]])  # fmt: skip
    robots = Robots(_members(["a", "b", "c"]), prior, run)
    joined = join(robots.blocks, prior, robots.ask, components=prior.usual)
    assert joined.converged
    assert (robots.names, len(joined.blocks)) == (["a", "c"], 2)
    assert "its solution does not follow the shape" in str(robots.problems["b"])


def test_robots_that_are_lost_on_the_way_leave_too_few(prior: ShapePrior) -> None:
    parts: list[Part | None] = [_part(prior, k, f"drive {k}") for k in range(2)]
    robots = Robots(_members(["a", "b"]), prior, _Spoken(parts, [parts[0], None]))
    robots.ask(np.zeros(len(prior.names)))
    with pytest.raises(CalibError, match="1 of 2 robots can take part in the joint solution, at least 2 are needed"):
        robots.ask(np.zeros(len(prior.names)))


def test_one_drive_under_two_names_counts_once(prior: ShapePrior) -> None:
    parts: list[Part | None] = [_part(prior, k, drive) for k, drive in enumerate(("d", "e", "d"))]
    robots = Robots(_members(["a", "b", "c"]), prior, _Spoken(parts))
    assert robots.names == ["a", "b"]
    assert str(robots.problems["c"]) == "its drive is that of a; give each drive once, by one name"


def test_the_librarys_call_goes_on_without_robots_that_fail_or_are_lost(drives: dict[str, Correspondences]) -> None:
    def run(work: Work, *each: Iterable[Any]) -> Iterator[Any]:
        for arguments in zip(*each, strict=True):
            robot = arguments[0].job.robot
            if work is calibrated and robot == "r0":
                yield None
            elif work is calibrated and robot == "r1":
                yield CalibError("too few stops")
            else:
                yield work(*arguments)

    bad = replace(drives["r2"], stops=drives["r2"].stops[:1])
    found = refine_box({**drives, "bad": bad, "again": drives["r2"]}, TARGET, run=run)
    assert list(found.calibrations) == ["r2"]
    assert set(found.left_out) == {"r0", "r1", "bad", "again"}
    assert found.left_out["r0"].endswith("the process that worked on it was lost")
    assert found.left_out["r1"].endswith("too few stops")
    assert found.left_out["again"].startswith("its drive is that of r2")


def test_what_the_others_told_may_make_no_box_for_one_robot() -> None:
    (member,) = _members(["a"])
    error = CalibError("no box")
    assert calibrated(member, error, TARGET) is error


@pytest.fixture(scope="module")
def of_an_earlier_run(drives: dict[str, Correspondences], tmp_path_factory: pytest.TempPathFactory) -> list[Outcome]:
    """Return the outcomes of three robots of a run with ``--joint-box``, as the next run finds them."""
    folder = tmp_path_factory.mktemp("robots")
    jobs = []
    for name, drive in drives.items():
        drive.save(folder / f"{name}.npz")
        settings = Settings(report=False)
        jobs.append(Job(robot=name, logs=(folder / f"{name}.npz",), target=TARGET, settings=settings, out=folder))
    own = list(calibrate_fleet(jobs, engine=ThisProcess()))
    together = refine(own, ThisProcess(), folder, "calibration")
    assert not together.failed
    assert all(_is_joint(outcome) for outcome in together.outcomes)
    return [replace(outcome, job=job) for outcome, job in zip(together.outcomes, jobs, strict=True)]


def _is_joint(outcome: Outcome) -> bool:
    assert outcome.calibration is not None
    assert outcome.job.out is not None
    written = load_calibration(outcome.job.out / outcome.job.robot / "calibration.json")
    assert written.provenance.fingerprint == outcome.calibration.provenance.fingerprint
    return written.provenance.fingerprint.endswith(JOINT)


def test_a_robot_that_is_left_out_does_not_keep_an_earlier_joint_result(
    of_an_earlier_run: list[Outcome], monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_r1(member: Member, names: Sequence[str]) -> Part:
        return Part(problem=CalibError("no")) if member.job.robot == "r1" else begin(member, names)

    monkeypatch.setattr("boxcal.calib.joint_box.robots.begin", without_r1)
    folder = of_an_earlier_run[0].job.out
    assert folder is not None
    found = refine(of_an_earlier_run, ThisProcess(), folder, "calibration")
    assert not found.failed
    assert [_is_joint(outcome) for outcome in found.outcomes] == [True, False, True]
    assert "anew by themselves, since their results were of an earlier joint solution: r1" in found.lines[-1]


def test_a_box_that_cannot_be_solved_leaves_no_earlier_joint_results(
    of_an_earlier_run: list[Outcome], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("boxcal.calib.joint_box.robots.begin", lambda *_, **__: Part(problem=CalibError("no")))
    folder = of_an_earlier_run[0].job.out
    assert folder is not None
    found = refine(of_an_earlier_run[:2], ThisProcess(), folder, "calibration")
    assert found.failed
    assert not any(_is_joint(outcome) for outcome in found.outcomes)
    assert f"calibration/{REFINED} is of an earlier run" in "\n".join(found.lines)
