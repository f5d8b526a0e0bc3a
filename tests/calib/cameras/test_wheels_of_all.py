"""Causes in the wheels as all cameras of a robot tell them."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.diagnosis.explained_estimate import ExplainedEstimate, explained_estimate
from boxcal.calib.diagnosis.wheels_of_all import solve_explained
from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.cameras.estimates import Cameras, solve_cameras
from boxcal.calib.simulate.imperfections import WheelFaults
from tests.calib.cameras.conftest import SLIP, Rigged, ahead_and_behind, rigged

OPTIONS = EstimateOptions(systematic_share=0.0)


def explained(rig: Rigged) -> list[ExplainedEstimate]:
    lenses = [robot.camera.kind for robot in rig.robots]
    return [explained_estimate([v], None, replace(OPTIONS, lens=k)) for v, k in zip(rig.views, lenses, strict=True)]


def together(rig: Rigged, alone: list[ExplainedEstimate]) -> Cameras:
    return solve_explained(alone, [[view] for view in rig.views])


@pytest.fixture(scope="module")
def scrubbing() -> tuple[Rigged, list[ExplainedEstimate]]:
    """Turns to the left lose 1 % more than those to the right."""
    rig = rigged(ahead_and_behind(), wheels=WheelFaults(slip=SLIP, scrub=(0.01, 0.0, 0.0)))
    return rig, explained(rig)


def test_cause_that_no_camera_shows_by_itself_is_found_together(
    scrubbing: tuple[Rigged, list[ExplainedEstimate]],
) -> None:
    rig, alone = scrubbing
    assert not [finding for camera in alone for finding in camera.found.findings if finding.cause == "scrub"]
    both = together(rig, alone)
    assert [[f.cause for f in e.findings if f.adopted] for e in both.estimates] == [["scrub"], ["scrub"]]
    first, second = both.estimates
    assert np.array_equal(first.cov[WHEELS, WHEELS], second.cov[WHEELS, WHEELS])
    robot = rig.robots[0]
    off = np.array([first.rR - robot.rR, first.rL - robot.rL, first.b - robot.b])
    assert np.all(np.abs(off) < 3.5 * np.sqrt(np.diag(first.cov)[WHEELS]))


def test_what_a_scrub_does_unseen_is_in_the_wheel_separation_once_and_in_the_cameras_places_alike(
    scrubbing: tuple[Rigged, list[ExplainedEstimate]],
) -> None:
    rig, alone = scrubbing
    both = together(rig, alone)
    b = rig.robots[0].b
    for own in both.estimates:
        assert own.odometry_cov is not None
        unseen = own.cov - own.odometry_cov
        assert np.isclose(unseen[7, 7], (0.01 * b) ** 2, rtol=0.02)
        assert np.isclose(unseen[11, 11], (0.005 * b) ** 2, rtol=0.02)
    tx = [3, 9]
    pair = np.diag(both.mountings)[tx].sum() - 2 * both.mountings[3, 9]
    assert pair < 0.2 * (0.005 * b) ** 2  # both move ahead together


def test_doubts_of_wheels_that_one_camera_has_are_judged_by_the_legs_of_all(front_and_rear: Rigged) -> None:
    alone = explained(front_and_rear)
    both = together(front_and_rear, alone)
    plain = solve_cameras([c.but_wheels for c in alone], [c.fit for c in alone], [[v] for v in front_and_rear.views])
    for own, bare in zip(both.estimates, plain.estimates, strict=True):
        assert np.all(np.linalg.eigvalsh(own.cov - bare.cov) > -1e-12 * np.abs(own.cov).max())
        assert not [finding for finding in own.findings if finding.adopted]
    assert np.all(np.diag(both.mountings) >= np.diag(plain.mountings))


def test_cameras_that_stay_apart_keep_what_each_shows_of_the_wheels(front_and_rear: Rigged) -> None:
    first, second = explained(front_and_rear)
    names = (*second.fit.problem.target.names, "another")
    other = replace(second.fit.problem, target=replace(second.fit.problem.target, names=names))
    alone = [first, replace(second, fit=replace(second.fit, problem=other))]
    both = together(front_and_rear, alone)
    assert "different unknowns" in both.apart
    assert [e is camera.found for e, camera in zip(both.estimates, alone, strict=True)] == [True, True]
