"""Cameras of every kind: a ray leads to a pixel, and the pixel back to the ray, or to NaN."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from boxcal.target.camera.camera_model import (
    CameraKind,
    CameraModel,
    project,
    project_with_jacobians,
    unproject,
)
from boxcal.target.camera.distortion import DISTORTION_NAMES
from boxcal.target.camera.undistort import radius_limit


@st.composite
def cameras(draw: st.DrawFn) -> CameraModel:
    """Cameras as they are built, bent up to what a wide lens does; some fold over within the image."""
    kind = draw(st.sampled_from(CameraKind))
    width = {"p1": 0.01, "p2": 0.01}
    bent = {n: draw(st.floats(-width.get(n, 0.4), width.get(n, 0.4))) for n in DISTORTION_NAMES[kind]}
    return CameraModel(
        kind=kind, fu=draw(st.floats(200, 2000)), fv=draw(st.floats(200, 2000)), cu=draw(st.floats(200, 440)),
        cv=draw(st.floats(150, 330)), **bent,
    )  # fmt: skip


pixels = st.lists(st.tuples(st.floats(0, 639), st.floats(0, 479)), min_size=1, max_size=20).map(np.array)


@given(cameras(), pixels, st.floats(0.1, 10))
def test_a_pixel_s_ray_leads_back_to_it_at_any_distance(
    camera: CameraModel, uv_px: np.ndarray, distance: float
) -> None:
    xy = unproject(camera, uv_px)
    seen = np.all(np.isfinite(xy), axis=1)
    assert np.array_equal(np.isnan(xy[:, 0]), np.isnan(xy[:, 1]))
    rays = np.column_stack([xy[seen], np.ones(int(seen.sum()))])
    np.testing.assert_allclose(project(camera, distance * rays), uv_px[seen], rtol=0, atol=1e-6)


@given(cameras(), st.floats(0.0, 0.9), st.floats(-3.2, 3.2), st.floats(0.1, 10))
def test_a_ray_before_the_fold_comes_back_from_its_pixel(
    camera: CameraModel, share: float, angle: float, z: float
) -> None:
    """Without decentring, up to where the distorted radius stops growing, or a tangent of 1 where it never does."""
    camera = replace(camera, p1=0.0, p2=0.0)
    rho = share * min(radius_limit(camera.kind, np.array(camera.distortion)), 1.0)
    x, y = rho * np.cos(angle), rho * np.sin(angle)
    back = unproject(camera, project(camera, np.array([[x * z, y * z, z]])))[0]
    np.testing.assert_allclose(back, [x, y], rtol=0, atol=1e-8)


@given(cameras(), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.2, 5))
def test_derivatives_are_those_of_central_differences(camera: CameraModel, x: float, y: float, z: float) -> None:
    p, values = np.array([[x * z, y * z, z]]), camera.values
    uv, by_values, by_point = project_with_jacobians(camera.kind, values, p)
    np.testing.assert_allclose(uv, project(camera, p), rtol=0, atol=1e-9)
    for k, step in enumerate(np.maximum(np.abs(values) * 1e-6, 1e-6)):
        change = step * np.eye(len(values))[k]
        there, back = (project_with_jacobians(camera.kind, values + s * change, p)[0] for s in (1, -1))
        np.testing.assert_allclose(by_values[:, :, k], (there - back) / (2 * step), rtol=1e-5, atol=1e-4)
    for k in range(3):
        change = 1e-6 * z * np.eye(3)[k]
        numeric = (project(camera, p + change) - project(camera, p - change)) / (2e-6 * z)
        np.testing.assert_allclose(by_point[:, :, k], numeric, rtol=1e-5, atol=1e-3)


@given(cameras(), st.floats(-5, 5), st.floats(-5, 5), st.floats(-10, 0))
def test_nothing_behind_the_camera_has_a_pixel(camera: CameraModel, x: float, y: float, z: float) -> None:
    assert np.all(np.isnan(project(camera, np.array([[x, y, z]]))))
