"""A planned drive: what it promises, and where it goes."""

from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.plan_drive.robots import ROUGH, might_be
from boxcal.calib.planning.assumptions import Assumptions, assumed_model
from boxcal.calib.planning.dubins import dubins_curves, points_along
from boxcal.calib.planning.exchange import Problem
from boxcal.calib.planning.floor import Floor, free_space
from boxcal.calib.planning.goal import Goal, quantities
from boxcal.calib.planning.paths import CurveRouter, Router
from boxcal.calib.planning.plan import DrivePlan, PlanOptions, plan_drive
from boxcal.calib.planning.search import make_search, prior_information
from boxcal.calib.planning.tour import Tour, evaluated
from boxcal.calib.planning.views import tags_seen
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import Robot, turtlebot
from boxcal.calib.simulate.viewpoints import decodable_tags
from boxcal.calib.uncertainty.cramer_rao import Truth, cramer_rao
from boxcal.target.box import make_target

TARGET, ROBOT = make_target(), turtlebot()
GIVEN = Assumptions(growth=0.0)


@pytest.fixture(scope="module")
def plan() -> DrivePlan:
    return plan_drive(ROBOT, TARGET, PlanOptions(stops=8, candidates=60), GIVEN)


def bound(robot: Robot, poses: np.ndarray, stops: int) -> np.ndarray:
    """Return the figures that the Cramer-Rao bound gives for a drive as it is simulated."""
    rng = np.random.default_rng(3)
    drive = simulate_drive(
        robot, TARGET, DriveOptions(stops=stops, slip=GIVEN.slip), rng, poses if len(poses) else None
    )
    truth = Truth.of(robot, drive.stop_poses, slip=GIVEN.slip, encoder_step=GIVEN.encoder_step)
    truth = replace(truth, lean=GIVEN.lean, height=GIVEN.height, target=dict(GIVEN.target))
    seen = exact_correspondences(robot, TARGET, drive, GIVEN.corner_px, rng)
    cov = cramer_rao([seen], truth, EstimateOptions(lens=robot.camera.kind, target=TARGET))
    return np.array([bar.value for bar in quantities(ORDER, robot, robot.image_size, Goal()).bars(cov)])


def test_plan_promises_what_the_cramer_rao_bound_of_its_drive_says(plan: DrivePlan) -> None:
    promised = np.array([bar.value for bar in plan.bars])
    assert promised == pytest.approx(bound(ROBOT, plan.poses, 8), rel=0.2)  # slip moves stops


def test_plan_beats_a_drive_round_the_box_of_twice_the_stops(plan: DrivePlan) -> None:
    goals = np.array([bar.goal for bar in plan.bars])
    assert np.max(bound(ROBOT, plan.poses, 8) / goals) < np.max(bound(ROBOT, np.zeros((0, 3)), 16) / goals)


def test_every_stop_reads_enough_and_all_faces_are_seen(plan: DrivePlan) -> None:
    assert all(stop.tags >= 20 for stop in plan.stops)
    assert {face for stop in plan.stops for face in stop.faces} == {0, 1, 2, 3}


def test_ways_lead_from_stop_to_stop(plan: DrivePlan) -> None:
    for before, stop in zip(plan.stops[:-1], plan.stops[1:], strict=True):
        x, y, heading = before.pose
        for distance, turn in zip(stop.distance, stop.turn, strict=True):
            x, y = x + distance * np.cos(heading + turn / 2), y + distance * np.sin(heading + turn / 2)
            heading += turn
        assert [x, y, heading] == pytest.approx(stop.pose, abs=1e-9)


def test_as_few_stops_as_reach_the_goals() -> None:
    easy = plan_drive(ROBOT, TARGET, PlanOptions(candidates=60), GIVEN)
    assert easy.reached
    assert len(easy.stops) == 8
    hard = plan_drive(ROBOT, TARGET, PlanOptions(candidates=60, goal=replace(Goal(), straight=0.05)), GIVEN)
    assert hard.reached
    assert len(hard.stops) > 8
    assert hard.seconds > easy.seconds


def test_stops_see_the_box_whatever_the_robot_might_be() -> None:
    others = might_be(ROBOT, ROUGH)
    plan = plan_drive(ROBOT, TARGET, PlanOptions(stops=6, candidates=60), GIVEN, others=others)
    for robot in others:
        seen = tags_seen(robot, TARGET, plan.poses, GIVEN.min_side_px, margin=0.0)
        assert np.all(seen.sum(axis=1) >= 8)


def test_a_promise_holds_whichever_robot_it_is() -> None:
    searches = tuple(
        make_search(assumed_model(r, TARGET, GIVEN), Floor(), Goal(), count=12, rng=np.random.default_rng(1))
        for r in (ROBOT, *might_be(ROBOT, ROUGH))
    )
    priors = tuple(prior_information(s.model, s.choice.problem) for s in searches)
    tour = Tour(rows=(0, 1, 2, 3, 4, 5), spins=(0,) * 6)
    each = np.array([evaluated(s, p, tour).values for s, p in zip(searches, priors, strict=True)])
    assert len(set(each.argmax(axis=0))) > 1  # none of them is worst in every figure
    worst = Problem(searches=searches, priors=priors, faces=4).worst(tour)
    assert np.all(worst.values >= each)


def test_tags_seen_are_those_that_the_simulator_decodes() -> None:
    rng = np.random.default_rng(2)
    drive = simulate_drive(ROBOT, TARGET, DriveOptions(stops=4), rng)
    seen = tags_seen(ROBOT, TARGET, drive.stop_poses, 16.0, margin=0.0)
    for tags, T_box_cam in zip(seen, drive.T_box_cam, strict=True):
        decoded = set(decodable_tags(ROBOT, TARGET, T_box_cam).tolist())
        assert set(TARGET.tag_ids[tags].tolist()) <= decoded  # those at a grazing angle are not counted on
        assert tags.sum() >= 20


def test_ways_go_round_box_and_obstacles() -> None:
    space = free_space(Floor(obstacles=((0.8, -1.0, 1.0, 1.0),)), TARGET.box, 0.1)
    starts, goals = np.array([[-1.0, 0.0, 0.0]]), np.array([[1.5, 0.1, pi / 2]])
    router = Router(space)
    paths = router.paths(starts, goals)
    assert paths.possible[0]
    assert paths.length[0] > 2.7
    stations, _ = router.stations(starts[:, :2], goals[:, :2])
    chain = np.concatenate([starts[:, :2], stations[0]])
    assert np.all(space.clear(chain[:-1], chain[1:]))
    assert not space.clear(starts[:, :2], goals[:, :2])[0]


def test_dubins_curves_end_where_they_should_and_none_is_shorter_than_the_chord() -> None:
    rng = np.random.default_rng(0)
    starts, goals = rng.uniform(-2, 2, (200, 3)), rng.uniform(-2, 2, (200, 3))
    chord = np.hypot(*(goals - starts)[:, :2].T)
    for distance, turn in dubins_curves(starts, goals, 0.4):
        reached = np.all(np.isfinite(distance), axis=1)
        ends = points_along(starts[reached], distance[reached], turn[reached])[:, -1]
        assert ends == pytest.approx(goals[reached, :2], abs=1e-9)
        assert wrap(starts[reached, 2] + turn[reached].sum(axis=1) - goals[reached, 2]) == pytest.approx(0.0, abs=1e-9)
        assert np.all(distance[reached].sum(axis=1) >= chord[reached] - 1e-9)


def test_a_turning_radius_is_kept() -> None:
    space = free_space(Floor(), TARGET.box, 0.1)
    paths = CurveRouter(space, 0.4).paths(np.array([[-1.0, 0.5, 0.0]]), np.array([[1.0, 1.0, radians(200)]]))
    assert paths.possible[0]
    turns = paths.turn[0] != 0
    assert np.abs(paths.distance[0][turns] / paths.turn[0][turns]) == pytest.approx(0.4, rel=1e-9)
    plan = plan_drive(ROBOT, TARGET, PlanOptions(stops=5, candidates=60, turning_radius=0.3), GIVEN)
    for stop in plan.stops[1:]:
        assert np.all(np.abs(stop.distance) >= 0.3 * np.abs(stop.turn) * (1 - 1e-9))


def test_curves_do_not_pass_through_what_is_thin() -> None:
    wall = Floor(obstacles=((1.7, -10.0, 1.72, 10.0),), clearance=0.0)
    router = CurveRouter(free_space(wall, TARGET.box, 0.01), 0.4)
    assert not router.paths(np.array([[0.5, 1.0, 0.0]]), np.array([[6.5, 1.0, 0.0]])).possible[0]
    assert router.paths(np.array([[2.5, 1.0, 0.0]]), np.array([[6.5, 1.0, 0.0]])).possible[0]


def test_a_floor_without_room_is_refused_with_what_to_do() -> None:
    with pytest.raises(CalibError, match="no place on this floor"):
        plan_drive(ROBOT, TARGET, PlanOptions(stops=4, candidates=20, floor=Floor(bounds=(3.0, 3.0, 4.0, 4.0))))
    with pytest.raises(CalibError, match="leaves no room"):
        plan_drive(ROBOT, TARGET, PlanOptions(stops=4, floor=Floor(bounds=(0.0, 0.0, 0.2, 0.2))))


def test_a_robot_that_stands_too_close_can_drive_away() -> None:
    space = free_space(Floor(), TARGET.box, 0.1)
    close = np.array([[0.3, 0.3, 0.0]])  # within the clearance, not touching
    goals = np.array([[0.8, 0.6, 0.0]])
    paths = Router(space).paths(close, goals)
    assert not space.free(close[:, :2])[0]
    assert paths.possible[0]
    across = Router(space).paths(close, np.array([[-0.8, -0.6, 0.0]]))
    assert across.possible[0]
    assert across.length[0] > np.hypot(1.1, 0.9) + 0.05  # not through the box
