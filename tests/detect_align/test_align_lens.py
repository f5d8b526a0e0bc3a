"""Lenses from pinhole to fisheye: charts, rays, the rigid box before them, and tags that they curve."""

import numpy as np
import pytest
from aligned_views import SIZE, TARGET, pose, width_px
from fisheye_views import aimed, fisheye, fisheye_truth, fisheye_view

from boxcal.detect.alignment.backend import numba_backend
from boxcal.detect.alignment.box_pose import fit_box
from boxcal.detect.alignment.box_refinement import FITTED, Tangent, levenberg_marquardt, moved_by, predict
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.homography import least_squares_homography, map_points
from boxcal.detect.alignment.radial_camera import (
    P1,
    P2,
    depth,
    distort_locally,
    distorted,
    distortion_jacobian,
    fisheye_distortion,
    no_distortion,
    square,
    tangential,
    to_pixels,
    undistort_locally,
)

PLAIN = np.array([325.0, 236.0, 0.04, -0.01, 1 / 320, 0.002, 0.05, 0.01, 0.004, -0.003])
SIDEWAYS = fisheye_distortion(SIZE, 200.0)
LENSES = pytest.mark.parametrize("lens", [PLAIN, SIDEWAYS], ids=["plain", "fisheye"])
PLACES = {"centre": (320, 240), "side": (90, 265), "corner": (525, 105)}


def _pixels(count=60):
    return np.random.default_rng(1).uniform(0, 1, (count, 2)) * (np.array(SIZE) - 1)


def _rays(lens, uv):
    """Return the rays of pixels, by the tangential terms too."""
    d = square(lens, uv - lens[:2])
    d = d + tangential(lens, d)
    return np.column_stack([d, depth(lens, np.sum(d * d, axis=1) * lens[4] ** 2)[0]])


def _charts(uv, reach_px):
    near = uv[:, None] + np.random.default_rng(2).uniform(-reach_px, reach_px, (len(uv), 6, 2))
    return np.column_stack([uv, np.full(len(uv), 0.1)]), near


@LENSES
def test_rays_lead_back_to_their_pixels(lens):
    uv = _pixels()
    seen = to_pixels(lens, _rays(lens, uv) * np.linspace(0.5, 2, len(uv))[:, None])
    np.testing.assert_allclose(lens[:2] + distorted(lens, seen - lens[:2]), uv, atol=5e-3)
    lens = lens.copy()
    lens[8:] = 0
    np.testing.assert_allclose(to_pixels(lens, _rays(lens, uv) * np.linspace(0.5, 2, len(uv))[:, None]), uv, atol=1e-9)


def test_a_fisheye_sees_sideways_and_a_pinhole_does_not():
    assert (_rays(SIDEWAYS, _pixels())[:, 2] < 0).any()
    behind = np.array([[10.0, 3.0, -1.0], [0.0, 0.0, -1.0], [np.nan, 1.0, 1.0]])
    assert np.isnan(to_pixels(fisheye_distortion(SIZE, 1e9), behind)).all()


def test_angles_of_a_fisheye_grow_as_the_radius():
    for degrees in (30.0, 60.0, 80.0):
        angle = np.deg2rad(degrees)
        uv = to_pixels(SIDEWAYS, np.array([[np.sin(angle), 0, np.cos(angle) / 200.0]]))
        assert uv[0, 0] - SIDEWAYS[0] == pytest.approx(200.0 * angle, abs=0.3)


@LENSES
def test_bend_undoes_undistort_locally(lens):
    place, near = _charts(_pixels(), 25)
    np.testing.assert_allclose(distort_locally(lens, place, undistort_locally(lens, place, near)), near, atol=1e-9)


@LENSES
def test_a_charts_steps_are_pixels_at_its_centre(lens):
    place, near = _charts(_pixels(), 1e-4)
    np.testing.assert_allclose(undistort_locally(lens, place, near) * 10, near - place[:, None, :2], atol=1e-9)


@LENSES
def test_distortion_jacobian_is_its_derivative(lens):
    place, near = _charts(_pixels(), 25)
    xy, J = undistort_locally(lens, place, near), distortion_jacobian(lens, place, near)
    for k, step in enumerate(np.eye(2) * 1e-4):
        numeric = (distort_locally(lens, place, xy + step) - distort_locally(lens, place, xy - step)) / 2e-3
        np.testing.assert_allclose(numeric, J[..., k], atol=1e-6)


def test_a_plane_is_a_homography_on_a_chart_to_the_side_of_a_fisheye():
    on_plane = np.stack(np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-1, 1, 6)), -1).reshape(-1, 2)
    # across a ray at 85 degrees, tilted
    p_cam = [1, 0.1, 0.09] + on_plane[:, :1] * [0.1, 0.05, -0.3] + on_plane[:, 1:] * [0.02, 0.3, 0.05]
    uv = to_pixels(SIDEWAYS, p_cam * (1, 1, 1 / 200.0))
    place = np.array([[*uv.mean(axis=0), 0.05]])
    xy = undistort_locally(SIDEWAYS, place, uv[None])[0]
    np.testing.assert_allclose(map_points(least_squares_homography(on_plane, xy), on_plane), xy, atol=1e-9)
    bent = np.abs(map_points(least_squares_homography(on_plane, uv), on_plane) - uv).max()
    assert bent > 3.0


@LENSES
def test_derivatives_of_the_rigid_box_are_those_of_its_projection(lens):
    focal, lens = 200.0, lens.copy()
    lens[8:] = 0  # with tangential terms the centre's derivative is rounded to that without
    uv = _pixels()
    p_cam = _rays(lens, uv) * (1, 1, focal) * 0.002
    tangent = Tangent(focal, lens, p_cam, uv)
    assert tangent.before.all()
    np.testing.assert_allclose(tangent.off, 0, atol=1e-9)
    J = tangent.jacobian()
    for k in range(len(J)):
        seen = []
        for sign in (1, -1):
            f, moved, T = moved_by((focal, lens, np.eye(4)), sign * 1e-5 * np.eye(len(J))[k])
            seen.append(-Tangent(f, moved, p_cam @ T[:3, :3].T + T[:3, 3], uv).off.T)
        numeric = (seen[0] - seen[1]) / 2e-5
        np.testing.assert_allclose(J[k].T, numeric, atol=1e-6 * np.abs(numeric).max() + 1e-7)


def test_the_box_is_fitted_to_exact_corners_at_the_side_of_a_fisheye():
    camera = fisheye(180.0)
    T = aimed(pose(20.0, distance=0.4), camera, PLACES["side"])
    uv, seen = fisheye_truth(T, camera)
    fit = fit_box(TARGET, seen, uv[seen], image_size=SIZE, sigma_px=0.05)
    assert np.median(fit.off_px) < 0.03
    np.testing.assert_allclose(fit.T_cam_box, T, atol=0.01)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("fov_deg", [120.0, 150.0, 180.0, 210.0])
def test_tags_curved_by_a_fisheye_are_found_at_the_noise_limit(fov_deg, place):
    camera = fisheye(fov_deg, k=(-0.02, -0.004, 0.001, 0.0))
    T = aimed(pose(18.0, distance=0.36), camera, PLACES[place])
    uv, seen = fisheye_truth(T, camera)
    tags = detect_tags(fisheye_view(T, camera), TARGET)
    wanted = seen[width_px(uv[seen]) >= 10]
    assert len(wanted) > 15
    assert set(wanted) <= set(tags.ids)
    errors = tags.corners_px - uv[tags.ids]
    assert np.abs(errors).max() < 0.2
    errors = errors[np.isin(tags.ids, wanted)]
    assert np.sqrt((errors**2).sum(axis=2).mean()) < 0.025
    cov = tags.cov_px2[np.isin(tags.ids, wanted)]
    assert 0.6 < np.linalg.solve(np.linalg.cholesky(cov), errors[..., None]).std() < 1.4


def test_one_face_at_the_side_of_a_fisheye_is_not_taken_for_a_decentred_lens():
    """Tangential terms as large as the corners alone would have them curve the tags' charts: then rms is .022 px."""
    camera = fisheye(210)
    T = aimed(pose(5, distance=0.345, elevation_deg=15), camera, (0.14 * 640, 0.55 * 480))
    uv, seen = fisheye_truth(T, camera)
    tags = detect_tags(fisheye_view(T, camera, seed=215), TARGET)
    wanted = seen[width_px(uv[seen]) >= 10]
    assert set(wanted) <= set(tags.ids)
    assert tags.camera is not None
    assert np.abs(tags.camera.prior.lens[[P1, P2]]).max() < 0.005
    errors = (tags.corners_px - uv[tags.ids])[np.isin(tags.ids, wanted)]
    assert np.sqrt((errors**2).sum(axis=2).mean()) < 0.018


@pytest.mark.parametrize(
    ("lens", "focal", "off_px"), [(PLAIN, 450.0, 0.3), (SIDEWAYS, 200.0, 0.3), (PLAIN, 450.0, 6.0)]
)
def test_compiled_fit_of_the_rigid_box_is_that_in_numpy(lens, focal, off_px):
    pytest.importorskip("numba", reason="numba is not installed")
    T = pose(20.0)
    rows = np.flatnonzero(TARGET.tag_faces == 0)
    rng = np.random.default_rng(4)
    p_box = TARGET.tag_corners[rows].reshape(-1, 3)
    uv = to_pixels(lens, (p_box @ T[:3, :3].T + T[:3, 3]) * (1, 1, 1 / focal)) + rng.normal(0, off_px, (len(p_box), 2))
    started = no_distortion(SIZE) if lens is PLAIN else fisheye_distortion(SIZE, 230.0)
    expected = np.array([np.log(600.0), *started[FITTED]])
    prior = (0.3 / np.array([0.7, 32.0, 32.0, 0.15, 0.05, 0.02, 0.03, 0.003, 0.003, 0.003])) ** 2
    moved = T.copy()
    moved[:3, 3] += 0.02
    arguments = (p_box, uv, (1.1 * focal, started, moved), prior, expected, 0.3, 1.5)
    plain, fast = levenberg_marquardt(*arguments), numba_backend().levenberg_marquardt(*arguments)
    for a, b, tolerance in zip(plain, fast, (1e-6, 1e-4, 1e-8, 1.0, 1e-5), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-6, atol=tolerance)


@LENSES
def test_compiled_prediction_is_that_in_numpy(lens):
    pytest.importorskip("numba", reason="numba is not installed")
    rng = np.random.default_rng(5)
    p_box = rng.uniform(-0.5, 0.5, (80, 3))
    A = rng.normal(0, 1, (16, 40))
    arguments = (p_box, 300.0, lens, pose(20.0, distance=0.4), A @ A.T)
    plain, fast = predict(*arguments), numba_backend().predict(*arguments)
    assert 0 < np.isnan(plain[0][:, 0]).sum() < 80 or lens is SIDEWAYS
    np.testing.assert_allclose(fast[0], plain[0], rtol=1e-9)
    np.testing.assert_allclose(fast[1], plain[1], rtol=1e-7)
    for compute in (predict, numba_backend().predict):
        places, none = compute(*arguments[:-1], None)
        np.testing.assert_allclose(places, plain[0], rtol=1e-9)
        assert len(none) == 0
