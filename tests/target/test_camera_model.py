"""The camera model: right forwards, right backwards or NaN, its derivatives those of central differences."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import (
    CameraKind,
    CameraModel,
    further_names,
    project,
    project_with_jacobians,
    unproject,
)
from boxcal.target.camera.undistort import radius_limit
from boxcal.target.errors import TargetError

CAMERAS = {
    "radial": CameraModel(fu=600.0, fv=590.0, cu=320.0, cv=240.0, kr=-0.2),
    "brown": CameraModel(
        fu=600.0, fv=590.0, cu=320.0, cv=240.0, kr=-0.25, k2=0.09, p1=2e-3, p2=-1.5e-3, k3=0.01, kind=CameraKind.BROWN
    ),
    "rational": CameraModel(
        fu=600.0, fv=590.0, cu=320.0, cv=240.0, kr=0.3, k2=0.05, p1=1e-3, p2=-2e-3, k3=0.01, k4=0.4, k5=0.02, k6=0.003,
        kind=CameraKind.RATIONAL,
    ),
    "fisheye": CameraModel(
        fu=290.0, fv=288.0, cu=320.0, cv=240.0, kr=0.03, k2=-0.02, k3=0.01, k4=-0.003, kind=CameraKind.FISHEYE
    ),
}  # fmt: skip
every_kind = pytest.mark.parametrize("camera", CAMERAS.values(), ids=list(CAMERAS))


def grid(columns: int = 33, rows: int = 25) -> Array:
    u, v = np.meshgrid(np.linspace(-0.5, 639.5, columns), np.linspace(-0.5, 479.5, rows))
    return np.stack([u, v], axis=-1)


def ahead(xy: Array) -> Array:
    return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)


@every_kind
def test_pixels_agree_with_opencv(camera: CameraModel) -> None:
    rng = np.random.default_rng(1)
    p = ahead(rng.uniform(-0.6, 0.6, (50, 2))) * rng.uniform(0.3, 2, (50, 1))
    zero, k = np.zeros(3), np.array(camera.distortion)
    if camera.kind is CameraKind.FISHEYE:
        expected, _ = cv2.fisheye.projectPoints(p[:, None], zero, zero, camera.K, k)
    else:
        expected, _ = cv2.projectPoints(p, zero, zero, camera.K, np.pad(k, (0, max(0, 4 - len(k)))))
    np.testing.assert_allclose(project(camera, p), expected.reshape(-1, 2), atol=1e-9)
    np.testing.assert_array_equal(project(camera, p), project_with_jacobians(camera.kind, camera.values, p)[0])


@every_kind
def test_unproject_undoes_project_over_the_whole_image(camera: CameraModel) -> None:
    xy = unproject(camera, grid())
    assert xy.shape == (25, 33, 2)
    np.testing.assert_allclose(project(camera, ahead(xy)), grid(), atol=1e-8)


@every_kind
def test_derivatives_agree_with_central_differences(camera: CameraModel) -> None:
    p = ahead(unproject(camera, grid(7, 5)).reshape(-1, 2)) * np.linspace(0.4, 2, 35)[:, None]
    p[0, :2] = 1e-5  # next to the optical axis
    _, d_values, d_point = project_with_jacobians(camera.kind, camera.values, p)
    for n, size in enumerate(np.maximum(np.abs(camera.values), 1)):
        h = 1e-6 * size * np.eye(len(camera.values))[n]
        numeric = [project_with_jacobians(camera.kind, camera.values + s * h, p)[0] for s in (1, -1)]
        np.testing.assert_allclose(d_values[:, :, n], (numeric[0] - numeric[1]) / (2e-6 * size), rtol=1e-6, atol=1e-5)
    for n, h in enumerate(1e-6 * np.eye(3)):
        numeric = [project_with_jacobians(camera.kind, camera.values, p + s * h)[0] for s in (1, -1)]
        np.testing.assert_allclose(d_point[:, :, n], (numeric[0] - numeric[1]) / 2e-6, rtol=1e-6, atol=1e-4)


coefficient = st.floats(-1.5, 1.5, allow_subnormal=False)


@settings(max_examples=150, deadline=None)
@given(kind=st.sampled_from(list(CameraKind)), k=st.lists(coefficient, min_size=8, max_size=8))
def test_unproject_answers_rightly_or_with_nan_whatever_the_coefficients(kind: CameraKind, k: list[float]) -> None:
    values = np.array([300.0, 310.0, 320.0, 240.0, *k[: 1 + len(further_names(kind))]])
    camera = CameraModel.from_values(kind, values)
    uv_px = grid(9, 7).reshape(-1, 2)
    xy = unproject(camera, uv_px)
    seen = np.isfinite(xy).all(axis=1)
    assert np.isnan(xy[~seen]).all()
    np.testing.assert_allclose(project(camera, ahead(xy[seen])), uv_px[seen], rtol=1e-7, atol=1e-6)
    rho = np.linalg.norm(xy[seen], axis=1)
    assert np.all(rho <= radius_limit(kind, values[4:]))
    assert seen[np.linalg.norm(uv_px - (320, 240), axis=1) < 1].all()  # the axis itself is always seen


def test_no_ray_leads_beyond_a_fold_or_a_pole() -> None:
    fold = CameraModel(fu=300.0, fv=300.0, cu=320.0, cv=240.0, kr=-0.9)
    assert radius_limit(fold.kind, np.array([-0.9])) == pytest.approx(1 / np.sqrt(2.7))
    corner = np.array([639.0, 479.0])
    assert np.isnan(unproject(fold, corner)).all()
    pole = CameraModel(fu=300.0, fv=300.0, cu=320.0, cv=240.0, k4=-1.0, kind=CameraKind.RATIONAL)  # 1 / (1 - rho^2)
    assert radius_limit(pole.kind, np.array(pole.distortion)) == pytest.approx(1.0)
    xy = unproject(pole, grid())
    assert np.isfinite(xy).all()
    assert np.linalg.norm(xy, axis=-1).max() < 1
    wide = CameraModel(fu=100.0, fv=100.0, cu=320.0, cv=240.0, kind=CameraKind.FISHEYE)  # 90 deg off the axis: 157 px
    assert np.isnan(unproject(wide, np.array([320.0 + 158, 240.0]))).all()
    assert np.isfinite(unproject(wide, np.array([320.0 + 156, 240.0]))).all()


def test_points_behind_the_camera_have_no_pixel() -> None:
    uv_px = project(CAMERAS["radial"], np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert np.isnan(uv_px[:2]).all()
    np.testing.assert_array_equal(uv_px[2], (320, 240))


def test_coefficients_have_names_whatever_order_they_come_in() -> None:
    brown = CAMERAS["brown"]
    named = {"k3": 0.01, "p2": -1.5e-3, "p1": 2e-3, "k2": 0.09}
    intrinsics = {"kr": -0.25, "cv": 240.0, "cu": 320.0, "fv": 590.0, "fu": 600.0}
    assert CameraModel.from_names(CameraKind.BROWN, intrinsics, named) == brown
    assert brown.distortion == (-0.25, 0.09, 2e-3, -1.5e-3, 0.01)
    assert CameraModel.from_values(CameraKind.BROWN, brown.values) == brown
    with pytest.raises(TargetError, match="k3 missing or too much"):
        CameraModel.from_names(CameraKind.BROWN, intrinsics, {n: v for n, v in named.items() if n != "k3"})
    with pytest.raises(TargetError, match="k4 missing or too much"):
        CameraModel.from_names(CameraKind.BROWN, intrinsics, {**named, "k4": 0.0})
    with pytest.raises(TargetError, match="k2 given, a radial model has kr"):
        CameraModel(fu=1.0, fv=1.0, cu=0.0, cv=0.0, k2=0.1)
