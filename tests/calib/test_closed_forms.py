"""Short ways give what the long ones give."""

import io
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import logsumexp

from boxcal.calib.diagnosis.catalogue import candidates
from boxcal.calib.four_steps.zhang_init import face_homographies
from boxcal.calib.geometry.diff_drive import legs_between
from boxcal.calib.geometry.two_by_two import determinants, inverse_roots, inverses, products
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.camera_selection import with_camera, without_further
from boxcal.calib.likelihood.corner_floor import with_floor
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.likelihood.explanation_equations import explanation_equations, extended, new_columns
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.information_inverse import determinant, invert
from boxcal.calib.likelihood.leg_residuals import leg_equations
from boxcal.calib.likelihood.levenberg_marquardt import (
    Weights,
    leg_information,
    linearize,
    picture_equations,
    reweighted,
    rewhitened,
)
from boxcal.calib.likelihood.log_sum import log_sum
from boxcal.calib.likelihood.normal_equations import eliminate
from boxcal.calib.likelihood.problem import with_kind
from boxcal.calib.likelihood.stop_elimination import eliminate_chain
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind
from boxcal.target.files.npz import npz_bytes


def _drive(stops: int) -> Correspondences:
    rng = np.random.default_rng(stops)
    driven = simulate_drive(khepera(), make_target(), DriveOptions(stops=stops, slip=3e-4), rng)
    return exact_correspondences(khepera(), make_target(), driven, 0.2, rng)


@pytest.fixture(scope="module")
def solved() -> Fit:
    return fit([_drive(8)], None, EstimateOptions(lens=CameraKind.BROWN, target=make_target()))


def test_matrices_of_two_by_two():
    rng = np.random.default_rng(1)
    half, v = rng.normal(size=(50, 2, 2)), rng.normal(size=(50, 2))
    cov = half @ np.swapaxes(half, 1, 2) + 1e-3 * np.eye(2)
    np.testing.assert_allclose(determinants(half), np.linalg.det(half), rtol=1e-12)
    np.testing.assert_allclose(inverses(half), np.linalg.inv(half), rtol=1e-9)
    np.testing.assert_allclose(products(half, v), np.einsum("nij,nj->ni", half, v), rtol=1e-12)
    np.testing.assert_allclose(inverse_roots(cov), np.linalg.inv(np.linalg.cholesky(cov)), rtol=1e-9, atol=1e-12)


def test_root_of_no_covariance_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        inverse_roots(np.array([[[1.0, 2.0], [2.0, 1.0]]]))


@pytest.mark.parametrize("open_directions", [0, 2])
def test_determinant_is_that_of_the_inverse(open_directions):
    rng = np.random.default_rng(2)
    half = rng.normal(size=(3, 6, 9))
    half[:, :open_directions] = 0.0
    S, right = half @ np.swapaxes(half, 1, 2), rng.normal(size=(3, 6))
    inverse, log_det = invert(S)
    ours = determinant(S, right)
    np.testing.assert_allclose(ours[0], log_det, rtol=1e-12)
    np.testing.assert_allclose(ours[1], np.einsum("ki,kij,kj->k", right, inverse, right), rtol=1e-10)


def test_log_sum():
    values = np.array([[-1e4, 3.0, 2.0], [-np.inf, -np.inf, -np.inf], [0.0, -800.0, 700.0]])
    for axis in (0, 1):
        np.testing.assert_allclose(log_sum(values, axis), logsumexp(values, axis=axis), rtol=1e-14)


@pytest.mark.parametrize("kept", [None, (0, 3, 4), (2, 5)])
def test_legs_are_the_ways_between_stops_one_behind_the_other(kept):
    drive = _drive(6)
    covered = drive.wheels.covered.copy()
    covered[drive.stops[3].last_sample + 2] = False
    drive = replace(drive, wheels=replace(drive.wheels, covered=covered))
    legs = legs_between(drive, kept)
    kept = kept or tuple(range(6))
    ways = [np.stack(drive.leg(i), axis=1) for i in range(kept[0], kept[-1])]
    np.testing.assert_array_equal(
        np.stack([legs.dphi_R, legs.dphi_L], axis=1), np.concatenate([np.diff(way, axis=0) for way in ways])
    )
    np.testing.assert_array_equal(legs.phi_start, np.concatenate([way[:-1] for way in ways]))
    before = np.cumsum([0, *(len(way) - 1 for way in ways)])
    assert legs.ends == tuple(int(before[k - kept[0]]) for k in kept)
    assert legs.known.tolist() == [not a <= 3 < b for a, b in pairwise(kept)]
    assert np.all(np.diff(legs.t_start_ns) > 0)
    assert len(legs.t_start_ns) == len(legs.dphi_R)


def test_homographies_are_those_of_the_faces():
    """Of exact corners without distortion: each takes the plane of its face to where the camera sees it."""
    robot = replace(khepera(), camera=replace(khepera().camera, kr=0.0))
    driven = simulate_drive(robot, make_target(), DriveOptions(stops=5), np.random.default_rng(4))
    seen = exact_correspondences(robot, make_target(), driven, 0.0, np.random.default_rng(4))
    found = face_homographies(seen.stops)
    assert len(found) == sum(np.count_nonzero(np.bincount(stop.faces) >= 8) for stop in seen.stops)
    K = robot.camera.K
    for H in found:
        r = np.linalg.inv(K) @ H[:, :2]
        assert abs(r[:, 0] @ r[:, 1]) < 1e-7 * (r[:, 0] @ r[:, 0])
        assert r[:, 0] @ r[:, 0] == pytest.approx(r[:, 1] @ r[:, 1], rel=1e-7)


def test_explanations_have_the_equations_that_linearizing_them_gives(solved):
    """Causes in pictures and in the wheels, beside one that is part of the model."""
    every = candidates(solved)
    problem, state = extended(solved.problem, solved.state, every[-3:-2])
    state = replace(state, explained=state.explained + 1e-3)
    with_one = replace(solved, problem=problem, at=linearize(problem, state, solved.weights))
    causes = [every[0], every[6], every[10], every[-1]]
    slip = solved.profile.slip[-3:]
    ours = explanation_equations(with_one, solved.components, slip, new_columns(with_one, causes))
    wider, there = extended(problem, state, causes)
    at = linearize(wider, there, solved.weights)
    pictures, _ = eliminate(picture_equations(wider, at, solved.components)[0])
    legs = leg_equations(wider, at.legs, leg_information(wider, at.legs, solved.weights, slip))
    whole = eliminate_chain(pictures.plus(legs))
    n = len(problem.names)
    information = whole.information - np.diag(np.append(np.zeros(n), 1 / np.square(wider.prior[n:])))

    def compare(mine, theirs):
        np.testing.assert_allclose(mine, theirs, atol=1e-9 * np.abs(theirs).max(), rtol=1e-6)

    compare(ours.information, information[:, :n, :n])
    compare(ours.right, whole.right[:, :n])
    compare(ours.with_shared, information[:, n:, :n])
    compare(ours.right_new, whole.right[:, n:])
    first = 0
    for cause in causes:
        rows = first + np.arange(len(cause.prior))[None]
        compare(ours.blocks(rows)[0], information[:, n:, n:][:, rows[0][:, None], rows[0]])
        first += len(cause.prior)


def test_corners_weighed_anew_are_as_linearized_anew(solved):
    weights = Weights(corners=(np.arange(len(solved.problem.uv_px)) % 7 > 0).astype(float), legs=solved.weights.legs)
    other = with_floor(solved.problem, 0.3)
    pairs = (
        (reweighted(solved.problem, solved.at, weights.corners), linearize(solved.problem, solved.state, weights)),
        (rewhitened(solved.problem, other, solved.at, weights), linearize(other, solved.state, weights)),
    )
    for mine, theirs in pairs:
        np.testing.assert_allclose(mine.corner_normal.A, theirs.corner_normal.A, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(mine.corner_local.by_chain, theirs.corner_local.by_chain, rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(mine.corner_squares, theirs.corner_squares, rtol=1e-9)


def test_a_simpler_camera_model_begins_near_its_end(solved):
    simple = with_kind(solved.problem, CameraKind.RADIAL)
    ends = [
        linearize(simple, with_camera(solved.problem, state, CameraKind.RADIAL), solved.weights).corner_squares.sum()
        for state in (without_further(solved), solved.state)
    ]
    least = fit(
        [_drive(8)], None, EstimateOptions(lens=CameraKind.RADIAL, target=make_target())
    ).at.corner_squares.sum()
    assert abs(ends[0] / least - 1) < 0.05 * abs(ends[1] / least - 1)


def test_compressed_arrays_are_read_back():
    arrays = {"a": np.arange(5), "header": np.frombuffer(b"{}", dtype=np.uint8), "c": np.zeros((0, 2))}
    content = npz_bytes(arrays)
    assert content == npz_bytes(arrays)
    with np.load(io.BytesIO(content), allow_pickle=False) as back:
        assert back.files == list(arrays)
        for name, values in arrays.items():
            np.testing.assert_array_equal(back[name], values)
