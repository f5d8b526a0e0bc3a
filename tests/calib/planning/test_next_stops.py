"""What a drive in progress has told, and what the next stop promises."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import gamma

import boxcal
from boxcal.calib.assessment.more_stops import MENDED_BY_STOPS
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.plan_drive.cli import main as plan_drive_command
from boxcal.calib.planning.chain import of_shared, quantity_values
from boxcal.calib.planning.drive_information import information_of, solved_by_estimate
from boxcal.calib.planning.floor import Floor
from boxcal.calib.planning.goal import Goal, along_camera, bars_of_estimate, quantities, worst
from boxcal.calib.planning.next_stops import NextStop, first_stops, next_stops, what_next
from boxcal.calib.planning.promise import Promise, promise_of
from boxcal.calib.results.verdict import Level
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.calib.uncertainty.propagation import ground_uncertainty
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target, make_target

OPTIONS = DriveOptions(stops=5, slip=5e-4)
Partial = tuple[Target, Drive, Correspondences, Estimate]


def solved(target: Target, drive: Drive, rng: np.random.Generator) -> tuple[Correspondences, Estimate]:
    seen = exact_correspondences(turtlebot(), target, drive, 0.05, rng)
    return seen, estimate([seen], options=EstimateOptions(target=target, systematic_share=0.0))


@pytest.fixture(scope="module")
def partial() -> Partial:
    rng, target = np.random.default_rng(1), make_target()
    drive = simulate_drive(turtlebot(), target, OPTIONS, rng)
    return target, drive, *solved(target, drive, rng)


def test_bars_are_the_estimates_own_uncertainty(partial: Partial) -> None:
    _, _, _, found = partial
    bars = {bar.name: bar.value for bar in bars_of_estimate(found)}
    ground = ground_uncertainty(found)
    assert bars["straight"] == pytest.approx(np.hypot(ground.straight.along, ground.straight.across), rel=1e-9)
    assert bars["heading"] == pytest.approx(ground.straight.heading, rel=1e-9)
    assert bars["turn"] == pytest.approx(ground.turn.heading, rel=1e-9)
    assert bars["camera"] == pytest.approx(max(found.sigma[k] for k in ("rx", "ry", "rz")), rel=1e-9)
    assert bars["place"] == pytest.approx(max(found.sigma[k] for k in ("tx", "ty", "tz")), rel=1e-9)
    assert bars["projection"] == pytest.approx(ground.projection.mean_px, rel=0.05)  # a coarser grid


def test_what_is_not_determined_has_an_infinite_bar(partial: Partial) -> None:
    _, _, _, found = partial
    cov = found.cov_all.copy()
    cov[7], cov[:, 7], cov[7, 7] = np.nan, np.nan, np.inf
    bars = {bar.name: bar for bar in bars_of_estimate(replace(found, cov_all=cov))}
    assert np.isinf(bars["turn"].value)
    assert not bars["turn"].reached
    assert np.isfinite(bars["camera"].value)


def test_information_of_a_drive_gives_the_estimates_sigmas_again(partial: Partial) -> None:
    target, _, drive, found = partial
    known = information_of(solved_by_estimate(found), [drive], target)
    rows = along_camera(quantities(known.names, found, drive.image_size, Goal()), found.T_body_cam[:3, :3])
    values = quantity_values(rows, of_shared(known.chain[None]))[0]
    expected = [bar.value for bar in bars_of_estimate(found)]
    # The estimate's covariance also holds that slip is not known exactly, and what leaving stops out says.
    assert np.all(values / expected > 0.7)
    assert np.all(values / expected < 1.1)


def test_next_stop_keeps_its_promise(partial: Partial) -> None:
    target, drive, seen, found = partial
    stop = what_next(found, [seen], target, count=1)[0]
    assert worst(stop.after).ratio < worst(stop.before).ratio
    goal = np.array([stop.x, stop.y, drive.stop_poses[-1, 2] + stop.turn])
    longer = simulate_drive(
        turtlebot(), target, OPTIONS, np.random.default_rng(1), np.concatenate([drive.stop_poses, goal[None]])
    )
    _, then = solved(target, longer, np.random.default_rng(2))
    promised = {bar.name: bar.value for bar in stop.after}
    for bar in bars_of_estimate(then):
        assert bar.value == pytest.approx(promised[bar.name], rel=0.4), bar.name


def test_a_promise_is_a_range_as_wide_as_slip_is_unsure(partial: Partial) -> None:
    target, _, seen, found = partial
    stop = what_next(found, [seen], target, count=1)[0]
    assert stop.promise == promise_of(found.noise.slip_sigma / found.noise.slip, 1)
    bar = replace(stop.after[0], value=0.02)
    wide = replace(stop, promise=Promise(low=0.4, middle=0.8, high=1.6))
    assert wide.promised(bar) == "1 cm to 4 cm"


def test_a_promised_range_is_where_the_slip_will_be_found() -> None:
    rng = np.random.default_rng(1)
    for legs, stops in ((4, 1), (4, 3), (9, 1)):
        now, new = 2 * legs - 3, 2 * stops
        known = rng.chisquare(now, 20_000) / now
        then = (now * known + rng.chisquare(new, 20_000)) / (now + new)
        found = np.sqrt(then * (now + new) / (now + new - 2)) / np.sqrt(known * now / (now - 2))
        mean = np.sqrt(now / 2) * gamma((now - 1) / 2) / gamma(now / 2)
        promise = promise_of(float(np.sqrt(now / (now - 2) / mean**2 - 1)), stops)
        assert 0.89 < np.mean((promise.low < found) & (found < promise.high)) < 0.995
        assert np.mean(found < promise.middle) == pytest.approx(0.5, abs=0.05)
        assert np.mean(found > promise.high) < 0.055
    assert promise_of(0.0, 3).high == pytest.approx(1.12)


def test_next_stops_stay_on_the_floor(partial: Partial) -> None:
    target, _, seen, found = partial
    floor = Floor(bounds=(-1.5, -0.2, 1.5, 1.5), obstacles=((0.2, 0.3, 0.5, 1.5),))
    stops = what_next(found, [seen], target, floor=floor, count=3)
    assert stops
    for stop in stops:
        assert -1.5 < stop.x < 1.5
        assert -0.2 < stop.y < 1.5
        assert not (0.2 < stop.x < 0.5 and 0.3 < stop.y < 1.5)
        assert stop.tags >= 20


def test_same_seed_gives_the_same_stops(partial: Partial) -> None:
    target, _, seen, found = partial

    def places(stops: tuple[NextStop, ...]) -> list[tuple[float, float, float]]:
        return [(s.x, s.y, s.heading) for s in stops]

    first, again = (what_next(found, [seen], target, count=2) for _ in range(2))
    assert places(first) == places(again)


def test_first_stops_see_the_box() -> None:
    target, robot = make_target(), turtlebot()
    stops = first_stops(robot, target, count=3)
    drive = simulate_drive(robot, target, replace(OPTIONS, stops=3), np.random.default_rng(1), stops)
    seen = exact_correspondences(robot, target, drive)
    assert all(len(stop.landmark_ids) >= 80 for stop in seen.stops)
    assert len(np.unique(np.concatenate([stop.faces for stop in seen.stops]))) >= 2


def test_verdict_of_an_unsure_drive_says_where_to_stop_next(partial: Partial) -> None:
    target, _, seen, _ = partial
    found = boxcal.calibrate(seen, target)
    assert found.verdict is not None
    unsure = [r for r in found.verdict.reasons if r.rule in MENDED_BY_STOPS and r.level is not Level.GOOD]
    assert all("Drive on from the last stop and stop at x " in r.advice for r in unsure)
    assert unsure[0].advice in found.verdict.next_steps


def test_next_stops_come_from_a_robots_folder_too(
    partial: Partial, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target, _, seen, _ = partial
    found = boxcal.calibrate(seen, target)
    boxcal.save_calibration(found, tmp_path / "calibration.json")
    seen.save(tmp_path / "correspondences.npz")
    assert plan_drive_command([str(tmp_path / "out"), "--after", str(tmp_path), "--stops", "2"]) in {0, 1}
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("1. Stop at x ")
    assert any(line.startswith("2. Stop at x ") for line in lines)
    stops = what_next(found, [seen], target, count=2)
    assert lines[0] == f"1. {stops[0].text}"


def test_what_a_drive_leaves_open_is_no_obstacle(partial: Partial) -> None:
    target, _, seen, found = partial
    known = information_of(solved_by_estimate(found), [seen], target)
    blind = replace(known, chain=known.chain * 1e-9)
    bars = tuple(replace(bar, value=np.inf) for bar in bars_of_estimate(found))
    stop = next_stops(blind, bars, Goal(), Floor(), count=1)[0]
    assert all(np.isfinite(bar.value) for bar in stop.after)
    assert stop.before == bars
    assert "unknown" in stop.text
