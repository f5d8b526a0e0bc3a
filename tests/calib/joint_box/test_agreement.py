"""Robots whose box was another one are found among those that saw the same, at a rate held over the fleet."""

import numpy as np
import pytest
from robots import TARGET

from boxcal.calib.joint_box.agreement import agreement
from boxcal.calib.joint_box.block import Block
from boxcal.calib.joint_box.posterior import posterior
from boxcal.calib.joint_box.shape_prior import ShapePrior, shape_prior
from boxcal.calib.joint_box.together import MOST_SPREAD
from boxcal.calib.likelihood import EstimateOptions
from boxcal.target.arrays import Array


@pytest.fixture(scope="module")
def prior() -> ShapePrior:
    return shape_prior(EstimateOptions(target=TARGET))


def _usual(prior: ShapePrior) -> Array:
    return np.sqrt(1 / np.diag(prior.equations(np.zeros(len(prior.names)), prior.usual)[0]))


def _blocks(prior: ShapePrior, shapes: list[Array], rng: np.random.Generator, noise: float = 1.0) -> list[Block]:
    """Return blocks of robots that tell 25 of the directions of a shape, each ten times as well as the prior."""
    usual, m, out = _usual(prior), len(prior.names), []
    for shape in shapes:
        J = 10 * rng.standard_normal((25, m)) / np.sqrt(m) / usual
        seen = J @ shape + noise * rng.standard_normal(25)
        out.append(Block(about=np.zeros(m), information=J.T @ J, score=J.T @ seen))
    return out


def _fleets(prior: ShapePrior, count: int, noise: float = 1.0) -> list[bool]:
    """Return whether any of 20 robots that saw one box was left out, for some fleets."""
    rng, found = np.random.default_rng(3), []
    for _ in range(count):
        shape = _usual(prior) * rng.standard_normal(len(prior.names))
        blocks = _blocks(prior, [shape] * 20, rng, noise)
        found.append(not agreement(blocks, prior, prior.usual, estimate_components=False).counts.all())
    return found


def test_fleets_that_saw_one_box_are_left_whole(prior: ShapePrior) -> None:
    """One in a hundred has a robot left out: of 40 fleets not more than 3 (p = 6e-4)."""
    assert sum(_fleets(prior, 40)) <= 3


def test_robots_that_all_err_more_than_they_say_agree_still_and_widen_the_sigmas(prior: ShapePrior) -> None:
    assert sum(_fleets(prior, 15, noise=1.5)) <= 3
    rng = np.random.default_rng(5)
    shape = _usual(prior) * rng.standard_normal(len(prior.names))
    spreads = [
        agreement(_blocks(prior, [shape] * 20, rng, noise), prior, prior.usual).posterior.spread for noise in (1.0, 1.5)
    ]
    assert 1.0 <= spreads[0] < 1.3
    assert 1.8 < spreads[1] < 2.8  # 1.5^2


@pytest.mark.parametrize("others", [1, 2, 7])
def test_robots_of_another_box_are_left_out_and_move_nobody(others: int, prior: ShapePrior) -> None:
    rng = np.random.default_rng(others)
    shape, another = _usual(prior) * rng.standard_normal((2, len(prior.names)))
    blocks = _blocks(prior, [another] * others + [shape] * (20 - others), rng)
    found = agreement(blocks, prior, prior.usual)
    assert found.majority
    np.testing.assert_array_equal(found.counts, np.arange(20) >= others)
    alone = posterior(blocks[others:], prior, prior.usual)
    np.testing.assert_allclose(found.posterior.shape, alone.shape, rtol=0, atol=1e-9 * _usual(prior).max())


@pytest.mark.parametrize(("others", "robots"), [(9, 20), (10, 20), (4, 8), (3, 7)])
def test_a_fleet_of_two_boxes_is_never_taken_for_one(others: int, robots: int, prior: ShapePrior) -> None:
    """Either just those of the other box are left out, or the scatter says that there is no common one."""
    for seed in range(3):
        rng = np.random.default_rng([seed, others, robots])
        shape, another = _usual(prior) * rng.standard_normal((2, len(prior.names)))
        found = agreement(_blocks(prior, [another] * others + [shape] * (robots - others), rng), prior, prior.usual)
        sorted_out = np.array_equal(found.counts, np.arange(robots) >= others)
        assert sorted_out or not found.majority or found.posterior.spread > MOST_SPREAD


def test_two_robots_that_differ_are_no_majority(prior: ShapePrior) -> None:
    rng = np.random.default_rng(1)
    shapes = list(_usual(prior) * rng.standard_normal((2, len(prior.names))))
    assert not agreement(_blocks(prior, shapes, rng), prior, prior.usual).majority


def test_a_robot_is_given_what_all_others_say_and_nothing_of_its_own(prior: ShapePrior) -> None:
    rng = np.random.default_rng(2)
    shape = _usual(prior) * rng.standard_normal(len(prior.names))
    blocks = _blocks(prior, [shape] * 6, rng)
    every = posterior(blocks, prior, prior.usual, estimate_components=False)
    mean, cov = every.without(blocks[2])
    others = posterior(blocks[:2] + blocks[3:], prior, prior.usual, estimate_components=False)
    unit = _usual(prior)
    np.testing.assert_allclose(mean / unit, others.shape / unit, rtol=0, atol=1e-9)
    np.testing.assert_allclose(cov / np.outer(unit, unit), others.cov / np.outer(unit, unit), rtol=0, atol=1e-9)


def test_the_shapes_covariance_holds_over_many_boxes(prior: ShapePrior) -> None:
    """Errors over sigmas, squared, are chi-square: of 200 boxes the mean is 31 within 4 of its own sigmas."""
    rng, m, squares = np.random.default_rng(8), len(prior.names), []
    for _ in range(200):
        shape = _usual(prior) * rng.standard_normal(m)
        found = posterior(_blocks(prior, [shape] * 3, rng), prior, prior.usual, estimate_components=False)
        d = found.shape - shape
        squares.append(d @ np.linalg.solve(found.cov, d))
    assert abs(np.mean(squares) - m) < 4 * np.sqrt(2 * m / 200)
