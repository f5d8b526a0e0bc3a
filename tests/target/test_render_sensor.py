"""Blur, exposure, tone curve and noise of rendered pictures."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel
from boxcal.target.errors import TargetError
from boxcal.target.render.psf import gather
from boxcal.target.render.renderer import render
from boxcal.target.render.sensor import SensorModel, expose, motion_kernel
from boxcal.target.render.srgb import srgb_from_linear

SIZE = (320, 240)
CAMERA = CameraModel(fu=300.0, fv=300.0, cu=159.5, cv=119.5, kr=0.0)
T_CAM_BOX = np.array([[0.0, 1, 0, 0], [0, 0, -1, 0.1], [-1, 0, 0, 0.5], [0, 0, 0, 1]])


def spread(image: np.ndarray) -> np.ndarray:
    """Return mean (u, v) and variance (u, v) of the light of a picture."""
    weight = image.astype(float) / image.sum()
    v, u = np.indices(image.shape)
    mean = np.array([(u * weight).sum(), (v * weight).sum()])
    return np.append(mean, [((u - mean[0]) ** 2 * weight).sum(), ((v - mean[1]) ** 2 * weight).sum()])


@pytest.mark.parametrize("noise", [2.0, 6.0])
def test_noise_has_the_standard_deviation_asked_for(noise: float) -> None:
    clean = render(make_target(), CAMERA, T_CAM_BOX, SIZE, SensorModel(ink=0.2)).astype(float)
    noisy = render(make_target(), CAMERA, T_CAM_BOX, SIZE, SensorModel(ink=0.2, noise=noise), np.random.default_rng(3))
    off = (noisy - clean)[(clean > 40) & (clean < 215)]
    expected = np.sqrt(noise**2 + 2 / 12)
    assert off.std() == pytest.approx(expected, abs=5 * expected / np.sqrt(2 * off.size))
    assert abs(off.mean()) < 0.1


def test_the_same_seed_gives_the_same_picture() -> None:
    sensor = SensorModel(noise=4)
    one, same, other = (
        render(make_target(), CAMERA, T_CAM_BOX, SIZE, sensor, np.random.default_rng(s)) for s in (5, 5, 6)
    )
    assert (one == same).all()
    assert (one != other).any()


def test_noise_does_not_wrap_around() -> None:
    sensor = SensorModel(noise=30, gain=3)
    image = render(make_target(), CAMERA, T_CAM_BOX, SIZE, sensor, np.random.default_rng(0))
    bright = render(make_target(), CAMERA, T_CAM_BOX, SIZE, SensorModel(gain=3)) == 255
    assert image[bright].min() > 50


@pytest.mark.parametrize(
    ("sensor", "variance"),
    [
        (SensorModel(psf_px=2.0), (4.0, 4.0)),
        (SensorModel(motion_blur_px=9.0), (81 / 12 + 1 / 96, 0.0)),
        (SensorModel(motion_blur_px=9.0, motion_angle=np.pi / 2), (0.0, 81 / 12 + 1 / 96)),
        (SensorModel(motion_blur_px=9.0, motion_angle=np.pi / 4), (81 / 24 + 1 / 96, 81 / 24 + 1 / 96)),
    ],
)
def test_blur_spreads_a_point_without_moving_it(sensor: SensorModel, variance: tuple[float, float]) -> None:
    light = np.zeros((61, 61), dtype=np.float32)
    light[28:31, 33:36] = 1
    at = np.flatnonzero(light)  # the point's pixels are known by their 4 x 4 cells
    gathered = gather(light, at, np.ones((len(at), 16), dtype=np.float32), sensor)
    found = spread(expose(gathered, replace(sensor, gain=2.5), None))
    # a square of 3 px: 9/12 px^2, seen through pixels: 1/12 more where the blur hides the lattice, 1/12 less where not
    box = np.where(np.array(variance) > 0, 10 / 12, 8 / 12)
    assert found[:2] == pytest.approx((34, 29), abs=0.02)
    assert found[2:] == pytest.approx(np.add(variance, box), rel=0.02)


def test_motion_kernel_keeps_light_and_place() -> None:
    for length in (0.3, 1.0, 7.7):
        kernel = motion_kernel(length, 0.4)
        assert kernel.sum() == pytest.approx(1, abs=1e-6)
        assert kernel == pytest.approx(kernel[::-1, ::-1], abs=1e-6)


def test_vignetting_takes_the_share_asked_for_from_the_corners() -> None:
    flat = np.full((121, 161), 200 / 255, dtype=np.float32)
    image = expose(flat, SensorModel(vignetting=0.4), None)
    assert image[0, 0] == image[-1, -1] == 120
    assert image[60, 80] == 200
    assert image[60, 0] == round(200 * (1 - 0.4 * 80**2 / (80**2 + 60**2)))


def test_gain_saturates() -> None:
    flat = np.full((4, 4), 0.4, dtype=np.float32)
    assert (expose(flat, SensorModel(gain=2), None) == 204).all()
    assert (expose(flat, SensorModel(gain=4), None) == 255).all()


def test_srgb_from_linear_has_its_standard_values() -> None:
    light = np.array([0.0, 0.002, 0.0031308, 0.2140411, 0.5, 1.0], dtype=np.float32)
    wanted = (0.0, 0.02584, 0.04045, 0.5, 0.7353570, 1.0)
    assert srgb_from_linear(light) == pytest.approx(np.array(wanted), abs=2e-6)
    assert expose(np.full((2, 2), 0.2140411, dtype=np.float32), SensorModel(srgb=True), None)[0, 0] in (127, 128)


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"noise": -1.0}, "noise is -1"),
        ({"noise": float("nan")}, "noise is nan"),
        ({"psf_px": 1e9}, "psf_px"),
        ({"motion_angle": float("inf")}, "motion_angle"),
        ({"paper": 1.5}, "paper is 1.5"),
        ({"shade": (1.0, 1.0)}, "five factors"),
        ({"supersample": 0}, "supersample is 0"),
        ({"background": "beach"}, "use one of plain, room"),
    ],
)
def test_impossible_looks_are_refused(figures: dict[str, Any], message: str) -> None:
    with pytest.raises(TargetError, match=message):
        SensorModel(**figures)


def test_noise_without_a_generator_is_refused() -> None:
    with pytest.raises(TargetError, match="pass rng"):
        expose(np.zeros((2, 2), dtype=np.float32), SensorModel(noise=1), None)
