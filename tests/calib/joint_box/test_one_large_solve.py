"""The joint solution by blocks is that of one large solve of all robots' unknowns together."""

from dataclasses import replace

import numpy as np
from robots import TARGET, Fleet, fleet, hand_made_box

from boxcal.calib.joint_box.gauge import gauge_free
from boxcal.calib.joint_box.own_solution import OwnSolution, shape_of
from boxcal.calib.joint_box.rounds import join
from boxcal.calib.likelihood.levenberg_marquardt import equations, linearize, moved
from boxcal.calib.likelihood.normal_equations import Normal
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array


def _dense(normal: Normal) -> tuple[Array, Array]:
    """Return all equations of one robot as one matrix: shared unknowns, then stop by stop chain and local ones."""
    n, (P, k) = len(normal.a), normal.c.shape
    local = normal.local
    assert local is not None
    q = local.c.shape[1]
    size = n + P * (k + q)
    H, g = np.zeros((size, size)), np.zeros(size)
    H[:n, :n], g[:n] = normal.A, normal.a
    for p in range(P):
        c = slice(n + p * (k + q), n + p * (k + q) + k)
        z = slice(c.stop, c.stop + q)
        H[:n, c], H[c, c], H[z, z], H[:n, z], H[c, z] = (
            normal.B[p],
            normal.D[p],
            local.D[p],
            local.by_shared[p],
            local.by_chain[p],
        )
        H[c, :n], H[z, :n], H[z, c] = normal.B[p].T, local.by_shared[p].T, local.by_chain[p].T
        g[c], g[z] = normal.c[p], local.c[p]
        if p + 1 < P:
            after = slice(c.start + k + q, c.start + 2 * k + q)
            H[c, after], H[after, c] = normal.E[p], normal.E[p].T
    return H, g


class _Robot:
    """One robot within the large solve, without any prior on the box."""

    def __init__(self, drive: object, own: OwnSolution, names: tuple[str, ...]) -> None:
        problem: Problem = own.problem([drive], TARGET)  # type: ignore[list-item]
        self.shape = [problem.names.index(name) for name in names]
        prior, information = problem.prior.copy(), problem.information.copy()
        prior[self.shape], information[self.shape], information[:, self.shape] = np.inf, 0.0, 0.0
        component = tuple("" if k in self.shape else name for k, name in enumerate(problem.component))
        problem = replace(problem, prior=prior, component=component, information=information)
        self.problem, self.own, self.state = problem, own, own.state
        self.rest = np.setdiff1d(np.arange(len(problem.names)), self.shape)

    def equations(self) -> tuple[Array, Array]:
        at = linearize(self.problem, self.state, self.own.weights(self.problem))
        return _dense(equations(self.problem, at, self.own.components, self.own.leg_information)[0])

    def move(self, d_shape: Array, d_own: Array) -> None:
        n, P = len(self.problem.names), len(self.problem.drive)
        d_shared = np.zeros(n)
        d_shared[self.shape], d_shared[self.rest] = d_shape, d_own[: len(self.rest)]
        stops = d_own[len(self.rest) :].reshape(P, -1)
        self.state = moved(self.problem, self.state, self.own.components, (d_shared, stops[:, :5], stops[:, 5:]))


def _with_shape(robot: _Robot, shape: Array, names: tuple[str, ...]) -> State:
    robot.move(shape - shape_of(robot.problem, robot.state, names), np.zeros(len(robot.equations()[1]) - len(names)))
    return robot.state


def _large_solve(team: Fleet, components: dict[str, float]) -> tuple[Array, Array, list[_Robot]]:
    """Return shape and its covariance of all unknowns in one matrix, and the robots as they end."""
    names = team.prior.names
    robots = [_Robot(d, o, names) for d, o in zip(team.drives, team.owns, strict=True)]
    shape = np.mean([block.about for block in team.first], axis=0)
    m = len(shape)
    for robot in robots:
        _with_shape(robot, shape, names)
    for _ in range(40):
        parts = [robot.equations() for robot in robots]
        sizes = [len(g) - m for _, g in parts]
        H, g = np.zeros((m + sum(sizes),) * 2), np.zeros(m + sum(sizes))
        first = m
        for robot, (own_H, own_g), size in zip(robots, parts, sizes, strict=True):
            rows = np.concatenate([np.arange(m), np.arange(first, first + size)])
            order = np.concatenate([robot.shape, np.setdiff1d(np.arange(len(own_g)), robot.shape)])
            H[np.ix_(rows, rows)] += own_H[np.ix_(order, order)]
            g[rows] += own_g[order]
            first += size
        free = gauge_free(team.prior, shape)  # what no robot can tell is left to the prior
        H[:m], g[:m] = free.T @ H[:m], free.T @ g[:m]
        H[:, :m] = H[:, :m] @ free
        prior = team.prior.equations(shape, components)
        H[:m, :m] += prior[0]
        g[:m] += prior[1]
        unit = 1 / np.sqrt(np.diag(H))
        step = unit * np.linalg.solve(H * np.outer(unit, unit), unit * g)
        shape = shape + step[:m]
        first = m
        for robot, size in zip(robots, sizes, strict=True):
            robot.move(step[:m], step[first : first + size])
            first += size
        if float(step @ H @ step) < 1e-21:
            break
    cov = np.outer(unit, unit) * np.linalg.inv(H * np.outer(unit, unit))
    return shape, cov[:m, :m], robots


def test_blocks_give_what_one_large_solve_gives() -> None:
    team = fleet([hand_made_box(0)] * 3)
    components = {name: 1.3 * sigma for name, sigma in team.prior.usual.items()}
    shape, cov, robots = _large_solve(team, components)
    joined = join(team.first, team.prior, team.ask, tolerance=1e-20, components=components)
    found = joined.agreement.posterior
    assert joined.converged
    assert joined.agreement.counts.all()
    sigma = np.sqrt(np.diag(cov))
    np.testing.assert_allclose(found.shape / sigma, shape / sigma, rtol=0, atol=1e-9 * np.abs(shape / sigma).max())
    np.testing.assert_allclose(found.cov / np.outer(sigma, sigma), cov / np.outer(sigma, sigma), rtol=0, atol=1e-7)
    for robot, own in zip(robots, team.owns, strict=True):
        np.testing.assert_allclose(own.state.wheels, robot.state.wheels, rtol=1e-9)
        np.testing.assert_allclose(own.state.lens, robot.state.lens, rtol=1e-9)
        np.testing.assert_allclose(own.state.T_body_cam, robot.state.T_body_cam, rtol=0, atol=1e-9)
        np.testing.assert_allclose(own.state.poses, robot.state.poses, rtol=0, atol=1e-9)
