"""From the linear intensity on the sensor to grey levels: exposure, response function, noise, rounding."""

from dataclasses import dataclass
from math import ceil, isfinite

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Reals
from boxcal.target.errors import TargetError
from boxcal.target.render.srgb import srgb_from_linear

BACKGROUNDS = ("plain", "room")
MAX_SUPERSAMPLE = 32
MAX_PSF_PX = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """Illumination, lens and sensor of a rendered image; the defaults give a sharp, noiseless one.

    Intensity is linear, 1 saturates the sensor at gain 1. With a linear response a grey level is 255 times it.

    Attributes
    ----------
    noise : grey levels (0..255)
        Standard deviation of the Gaussian noise, added after the response function.
    psf_px : px
        Standard deviation of the lens's Gaussian PSF; the pixel's own square comes on top.
    motion_blur_px : px
        How far the image moves during the exposure (whole length of the streak).
    motion_angle : rad
        Direction of that motion: 0 along u, positive towards v.
    vignetting
        Fraction of the light that the image's corners lose, 0..1; it grows with the squared distance to the centre.
    gain
        Exposure: factor on all light.
    paper, ink
        Reflectance of white and of black modules, 0..1.
    shade
        Illumination of faces 0, 1, 2, 3 and on the top, as factors.
    srgb
        Apply the sRGB response function (IEC 61966-2-1); linear otherwise.
    supersample
        Samples along each side of a pixel that an edge crosses; each is the mean over its own footprint.
    background
        ``plain`` (grey floor and wall) or ``room`` (tiled floor, furnished wall).
    """

    noise: float = 0.0
    psf_px: float = 0.0
    motion_blur_px: float = 0.0
    motion_angle: float = 0.0
    vignetting: float = 0.0
    gain: float = 1.0
    paper: float = 0.85
    ink: float = 0.05
    shade: tuple[float, float, float, float, float] = (1.0, 0.9, 0.8, 0.95, 0.85)
    srgb: bool = False
    supersample: int = 4
    background: str = "room"

    def __post_init__(self) -> None:
        limits = {
            "noise": 255.0,
            "psf_px": MAX_PSF_PX,
            "motion_blur_px": MAX_PSF_PX,
            "vignetting": 1.0,
            "gain": 1e3,
            "paper": 1.0,
            "ink": 1.0,
        }
        for name, high in limits.items():
            value = getattr(self, name)
            if not 0 <= value <= high:
                raise TargetError(f"sensor: {name} is {value}, a number from 0 to {high:g} is needed")
        if not isfinite(self.motion_angle):
            raise TargetError(f"sensor: motion_angle is {self.motion_angle}, a finite angle in rad is needed")
        if len(self.shade) != 5 or not all(0 <= s <= 1e3 for s in self.shade):
            raise TargetError(f"sensor: shade is {self.shade}, five factors from 0 on are needed (faces 0 to 3, top)")
        if not 1 <= self.supersample <= MAX_SUPERSAMPLE:
            raise TargetError(f"sensor: supersample is {self.supersample}, 1 to {MAX_SUPERSAMPLE} is needed")
        if self.background not in BACKGROUNDS:
            raise TargetError(f"sensor: background {self.background!r}, use one of {', '.join(BACKGROUNDS)}")


def expose(light: Reals, sensor: SensorModel, rng: np.random.Generator | None) -> NDArray[np.uint8]:
    """Return the grey image (H, W) of the light (H, W) on the sensor.

    Order: vignetting and exposure, response function, noise, rounding.

    Raises
    ------
    TargetError
        If the sensor has noise and there is no generator to draw it from.
    """
    if sensor.noise > 0 and rng is None:
        raise TargetError(
            f"sensor: noise is {sensor.noise:g} grey levels but no random generator was given", remedy="pass rng"
        )
    if sensor.vignetting > 0:
        light = light * _vignette(light.shape[0], light.shape[1], sensor.vignetting)
    light = np.clip(light * np.float32(sensor.gain), 0, 1)
    grey = 255 * (srgb_from_linear(light) if sensor.srgb else light)
    if sensor.noise > 0 and rng is not None:
        grey = grey + np.float32(sensor.noise) * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.asarray(np.rint(np.clip(grey, 0, 255)), dtype=np.uint8)


def motion_kernel(length_px: float, angle: float) -> Reals:
    """Return the kernel (odd, odd) of a straight streak through the centre pixel; it sums to 1.

    Its points are shared among the four pixels around them, which adds up to 1/6 px^2 to the variance on each axis.
    """
    half = length_px / 2
    count = 16 * ceil(length_px) + 1
    along = (np.arange(count) + 0.5) / count * length_px - half
    reach = ceil(half) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    u, v = along * np.cos(angle) + reach, along * np.sin(angle) + reach
    i, j = np.floor(u).astype(np.intp), np.floor(v).astype(np.intp)
    a, b = u - i, v - j
    for di, dj, weight in ((0, 0, (1 - a) * (1 - b)), (1, 0, a * (1 - b)), (0, 1, (1 - a) * b), (1, 1, a * b)):
        np.add.at(kernel, (j + dj, i + di), weight / count)
    return kernel.astype(np.float32)


def _vignette(height: int, width: int, lost: float) -> Reals:
    u = (np.arange(width, dtype=np.float32) - (width - 1) / 2) ** 2
    v = (np.arange(height, dtype=np.float32) - (height - 1) / 2) ** 2
    corner = max(float(u[0] + v[0]), 1.0)
    return np.asarray(1 - np.float32(lost / corner) * (u[None, :] + v[:, None]), dtype=np.float32)
