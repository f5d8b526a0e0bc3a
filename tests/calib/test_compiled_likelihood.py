from typing import Any

import numpy as np
import pytest

from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.geometry.diff_drive import Legs
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.backend import backend, numba_backend, numpy_backend
from boxcal.calib.likelihood.compiled import (
    chain,
    corner_sums,
    corners,
    leg_sums,
    legs,
    local_elimination,
    moved_points,
    small_matrices,
)
from boxcal.calib.likelihood.compiled.compilation import compile_all
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.likelihood.wheel_path import wheel_path
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.target.box import make_target

COMPILED, REFERENCE = numba_backend(), numpy_backend()


def test_plain_install_runs_compiled_loops():
    assert backend() is COMPILED


@pytest.mark.parametrize(("systems", "stops"), [(1, 1), (1, 20), (7, 3)])
def test_compiled_chain_is_the_reference(systems, stops):
    rng = np.random.default_rng(stops)
    half = rng.normal(size=(systems, stops, 5, 9))
    D = half @ np.swapaxes(half, -1, -2) + 3 * np.eye(5)
    E = 0.3 * rng.normal(size=D.shape)
    right = rng.normal(size=(systems, stops, 5, 11))
    found = []
    for compute in (COMPILED, REFERENCE):
        left = right.copy()
        pivots, gains, back, log_det = compute.eliminate_stops(D, E, left)
        forward = back.copy()
        compute.substitute_back(gains, back)
        found.append((pivots, gains, forward, back, left, log_det, *compute.chain_covariances(pivots, gains)))
    for ours, reference in zip(*found, strict=True):
        np.testing.assert_allclose(ours, reference, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("compute", [COMPILED, REFERENCE], ids=["compiled", "reference"])
def test_a_stop_that_nothing_holds_is_singular(compute):
    D = np.eye(5)[None, None].repeat(3, axis=1)
    D[0, 1] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        compute.eliminate_stops(D, np.zeros_like(D), np.ones((1, 3, 5, 2)))


@pytest.mark.parametrize("direct", [0, 4])
def test_compiled_rows_of_corners_are_the_reference(direct):
    rng = np.random.default_rng(1)
    drive = simulate_drive(khepera(), make_target(), DriveOptions(stops=3), rng)
    data = exact_correspondences(khepera(), make_target(), drive, 0.2, rng)
    options = EstimateOptions(target=make_target() if direct else None)
    problem = build_problem([data], [(0, 1, 2)], options, 0.0)
    assert problem.target.direct == direct
    L = len(problem.uv_px)
    parts = [rng.normal(size=shape) for shape in ((L, 2), (L, 2, 5), (L, 2, 3), (L, 3))]
    parts += [rng.integers(0, 4, L), rng.normal(size=(4, 3, 3))]
    for spare in (0, 1):
        both = (compute.corner_rows(problem, *parts, spare) for compute in (COMPILED, REFERENCE))
        for ours, reference in zip(*both, strict=True):
            np.testing.assert_allclose(ours, reference, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("left_out", [False, True])
def test_compiled_equations_of_corners_are_the_reference(left_out):
    """Of groups in any order, of columns that mostly change nothing; a stop has none."""
    rng = np.random.default_rng(2)
    L, G, m, n, k = 90, 5, 6, 11, 3
    weight = rng.uniform(0.2, 1, L) * (rng.random(L) > 0.2 * left_out)
    rows, group = (rng.normal(size=(L, 2, m)), rng.normal(size=(L, 2)), weight), rng.permutation(np.arange(L) % G)
    shared, own = (rng.normal(size=(G, m, w)) * (rng.random((G, m, w)) < 0.3) for w in (n, k))
    given = rows, group, np.array([0, 0, 1, 3, 3]), 4, shared, own
    for ours, reference in zip(COMPILED.corner_sums(*given), REFERENCE.corner_sums(*given), strict=True):
        assert ours.shape == reference.shape
        np.testing.assert_allclose(ours, reference, rtol=1e-11, atol=1e-11)

    sums = [compute.group_sums(rows, group, G) for compute in (COMPILED, REFERENCE)]
    np.testing.assert_allclose(*sums, rtol=1e-11, atol=1e-11)


def test_compiled_motion_of_points_is_the_reference():
    rng = np.random.default_rng(4)
    given = rng.normal(size=(3, 3, 3)), rng.normal(size=(3, 3)), rng.integers(0, 3, 40), rng.normal(size=(40, 3))
    np.testing.assert_allclose(COMPILED.moved_points(*given), REFERENCE.moved_points(*given), rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("explained", [0, 2])
def test_compiled_equations_of_legs_are_the_reference(explained):
    """Of two drives one behind the other, with unknowns of explanations among the shared ones or without."""
    rng = np.random.default_rng(5)
    K, N, P, n = 3, 4, 6, 12
    jacobian, residual = rng.normal(size=(N, 3, 13 + explained)), rng.normal(size=(N, 3))
    half = rng.normal(size=(K, N, 3, 3))
    stops, shared = np.array([0, 1, 3, 4]), np.r_[5:8, 9 : 9 + explained]
    shapes = (K, n, n), (K, n), (K, P, 5, 5), (K, P, 5, 5), (K, P, 5, n + 1)
    begun = tuple(rng.normal(size=shape) for shape in shapes)
    both = []
    for compute in (COMPILED, REFERENCE):
        to = tuple(part.copy() for part in begun)
        compute.add_legs(jacobian, residual, half @ np.swapaxes(half, -1, -2), stops, shared, to)
        both.append(to)
    for ours, reference in zip(*both, strict=True):
        np.testing.assert_allclose(ours, reference, rtol=1e-11, atol=1e-12)


def test_compiled_sums_over_samples_are_the_reference():
    rng = np.random.default_rng(8)
    given = (
        rng.normal(size=(2, 3, 30)),
        rng.normal(size=(30, 2, 4)) * (rng.random((30, 2, 4)) < 0.3),
        np.array([0, 4, 19]),
    )
    np.testing.assert_allclose(COMPILED.travelled(*given), REFERENCE.travelled(*given), rtol=1e-12, atol=1e-13)


def _definite(rng, *shape):
    half = rng.normal(size=(*shape, shape[-1] + 3))
    return half @ np.swapaxes(half, -1, -2)


def test_compiled_inverses_and_determinants_are_the_reference():
    rng = np.random.default_rng(6)
    scale = 10.0 ** rng.uniform(-4, 4, 8)
    S, right = _definite(rng, 2, 8) * scale[:, None] * scale, rng.normal(size=(2, 8))
    for name, given in (("inverses", (_definite(rng, 3, 2, 4),)), ("scaled_inverses", (S,)),
                        ("scaled_determinants", (S, right))):  # fmt: skip
        copies = [part.copy() for part in given]
        for ours, reference in zip(getattr(COMPILED, name)(*given), getattr(REFERENCE, name)(*given), strict=True):
            np.testing.assert_allclose(ours, reference, rtol=1e-9, err_msg=name)
        for part, before in zip(given, copies, strict=True):
            np.testing.assert_array_equal(part, before)


@pytest.mark.parametrize("compute", [COMPILED, REFERENCE], ids=["compiled", "reference"])
def test_matrices_without_an_inverse_are_told(compute):
    with pytest.raises(np.linalg.LinAlgError):
        compute.inverses(np.zeros((2, 3, 3)))
    indefinite = np.array([[1.0, 2.0], [2.0, 1.0]])
    assert compute.scaled_inverses(indefinite)[2] <= 0
    assert compute.scaled_determinants(indefinite, np.ones(2))[2] <= 0


def test_compiled_elimination_of_local_unknowns_is_the_reference():
    """One of them without any freedom."""
    rng = np.random.default_rng(7)
    P, n, q = 4, 6, 3
    whole = _definite(rng, P, n + 5 + q)
    A, B, D = whole[:, :n, :n].sum(axis=0), whole[:, :n, n : n + 5], whole[:, n : n + 5, n : n + 5]
    local = whole[:, n + 5 :, n + 5 :], whole[:, :n, n + 5 :], whole[:, n : n + 5, n + 5 :], rng.normal(size=(P, q))
    sigma = rng.uniform(0.5, 2, (P, q))
    sigma[:, 1] = 0.0
    given = (A, B, D, rng.normal(size=n), rng.normal(size=(P, 5))), local, 0.7, sigma, rng.normal(size=(P, q))
    ours, reference = COMPILED.without_local(*given), REFERENCE.without_local(*given)
    for mine, theirs in zip(
        (*ours[0], *ours[1], *ours[2:]), (*reference[0], *reference[1], *reference[2:]), strict=True
    ):
        np.testing.assert_allclose(mine, theirs, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("still", [False, True], ids=["both wheels roll", "a wheel stands on two legs"])
@pytest.mark.parametrize("added", [False, True], ids=["radii only", "explained travel"])
def test_compiled_legs_are_the_reference(still, added):
    rng = np.random.default_rng(3)
    dphi = np.round(rng.normal(0.2, 0.3, (60, 2)), 1)  # with samples in which a wheel stands
    dphi[30:34] = 0.31, -0.29  # on the spot
    if still:
        dphi[20:40, 0] = dphi[40:, 1] = 0.0
    path = wheel_path([Legs(dphi_R=dphi[:, 0], dphi_L=dphi[:, 1], ends=(0, 20, 40, 60))])
    wheels = np.array([0.0208, 0.0212, 0.0891])
    at_start, at_end = rng.normal(0, 1e-3, (2, 3, 2))
    more = rng.normal(0, 1e-4, (60, 2)) if added else None
    ours = COMPILED.propagate(path, wheels, at_start, at_end, more)
    reference = REFERENCE.propagate(path, wheels, at_start, at_end, more)
    assert len(ours) == len(reference)
    for mine, theirs in zip(ours, reference, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-10, atol=1e-12 * np.abs(theirs).max())


def test_nothing_is_compiled_in_use_beyond_what_is_prepared():
    compile_all()
    kernels: tuple[Any, ...] = (
        chain._eliminate,
        chain.substitute_back,
        chain._covariances,
        legs._propagate,
        legs._readings,
        corners.fill_rows,
        corner_sums.fill_sums,
        corner_sums.fill_equations,
        moved_points.move,
        leg_sums.add_to,
        leg_sums.add_travelled,
        small_matrices.sweep_all,
        small_matrices.sweep_scaled,
        small_matrices.factor_scaled,
        local_elimination.eliminate_local,
    )
    drive = simulate_drive(khepera(), make_target(), DriveOptions(stops=8, slip=3e-4), np.random.default_rng(1))
    seen = exact_correspondences(khepera(), make_target(), drive, 0.2, np.random.default_rng(2))
    estimate_explained([seen], None, EstimateOptions(lens=None, target=make_target()))
    assert [len(k.signatures) for k in kernels] == [1] * len(kernels)
