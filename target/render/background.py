"""Background of a rendered image: the floor z = 0 and, above the horizon, a distant wall."""

from functools import cache
from math import pi

import cv2
import numpy as np

from boxcal.target.arrays import Array, Reals
from boxcal.target.box import Box

FLOOR, WALL = 0.42, 0.55
"""Mean reflectance of the floor and the wall."""
_SIDE = 1024
_TEXEL = 0.0025
_TALL = 1.2
"""Tangent of the elevation at which the wall ends and the plain ceiling begins."""
_GRAIN = 0.03
"""Size of the floor's pattern, m; it fades where a pixel covers more than this."""


def background(
    rays: Reals, shape: tuple[int, int], T_cam_floor: Array, *, focal_px: float, box: Box, room: bool
) -> Reals:
    """Return the light of floor and wall (H, W) along the rays.

    Parameters
    ----------
    rays : (3, H * W)
        Directions (xc/zc, yc/zc, 1), row by row.
    shape
        (H, W).
    T_cam_floor : (4, 4), m
        Pose of the floor, its plane z = 0, seen from above only; the box stands about its origin.
    focal_px : px
        Mean focal length, which sets where the floor's pattern fades.
    box
        Casts a soft shadow on the floor around its base.
    room
        Whether floor and wall carry a pattern.
    """
    R = T_cam_floor[:3, :3]
    centre = -R.T @ T_cam_floor[:3, 3]
    dx, dy, dz = (R.T.astype(np.float32) @ rays).reshape(3, *shape)
    on_floor = dz < 0 if centre[2] > 0 else np.zeros(shape, dtype=bool)
    wall = _wall(dx, dy, dz) if room and not on_floor.all() else np.full(shape, WALL, dtype=np.float32)
    if not on_floor.any():
        return wall
    along = np.float32(-centre[2]) / np.minimum(dz, np.float32(-1e-4))
    x, y = dx * along + np.float32(centre[0]), dy * along + np.float32(centre[1])
    floor = _floor(x, y, along * along * np.float32(1 / (centre[2] * focal_px))) if room else np.float32(FLOOR)
    gap_x = np.maximum(np.abs(x) - np.float32(box.width / 2), 0)
    gap_y = np.maximum(np.abs(y) - np.float32(box.depth / 2), 0)
    shadow = np.float32(0.5) / (1 + (gap_x * gap_x + gap_y * gap_y) * np.float32((4 / box.height) ** 2))
    return np.where(on_floor, floor * (1 - shadow), wall)


def _floor(x: Reals, y: Reals, footprint: Reals) -> Reals:
    scale = np.float32(1 / _TEXEL)
    pattern = cv2.remap(_floor_table(), x * scale, y * scale, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    fade = 1 / (1 + (footprint * np.float32(1 / _GRAIN)) ** 2)
    return np.asarray(np.float32(FLOOR) * (1 + fade * pattern), dtype=np.float32)


def _wall(dx: Reals, dy: Reals, dz: Reals) -> Reals:
    azimuth = (np.arctan2(dy, dx) + np.float32(pi)) * np.float32((_SIDE - 1) / (2 * pi))
    level = np.hypot(dx, dy)
    level *= np.float32(_TALL)
    height = np.clip(dz * np.float32(_SIDE - 1) / np.maximum(level, np.float32(1e-6)), 0, _SIDE - 1)
    pattern = cv2.remap(_wall_table(), azimuth, height, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(pattern, dtype=np.float32)


@cache
def _floor_table() -> Reals:
    """Return the floor's relative pattern, (_SIDE, _SIDE): worn tiles of 0.32 m with joints."""
    rng = np.random.default_rng(1)
    tile = 128
    tiles = np.kron(rng.normal(0, 0.06, (_SIDE // tile, _SIDE // tile)), np.ones((tile, tile)))
    table = tiles + 0.06 * _cloud(rng, 6) + 0.05 * _cloud(rng, 2)
    at = np.arange(_SIDE) % tile < 2
    table[at, :] = -0.45
    table[:, at] = -0.45
    return np.asarray(cv2.GaussianBlur(table, (0, 0), 0.7, borderType=cv2.BORDER_REFLECT), dtype=np.float32)


@cache
def _wall_table() -> Reals:
    """Return the wall's reflectance, (_SIDE, _SIDE), azimuth by elevation: furniture, pictures, windows."""
    rng = np.random.default_rng(2)
    stain = _cloud(rng, 10)
    table = WALL + 0.03 * stain
    table[:12] = 0.15
    for _ in range(70):
        width, tall = rng.integers(15, 110), rng.integers(40, 330)
        left, low = rng.integers(0, _SIDE - width), rng.choice([12, 12, int(rng.integers(100, 450))])
        inside = (slice(low, low + tall), slice(left, left + width))
        table[inside] = rng.uniform(0.08, 0.95) + 0.04 * stain[inside]
        for shelf in range(low + 20, low + tall, int(rng.integers(25, 90))):
            table[shelf : shelf + 4, left : left + width] = rng.uniform(0.05, 0.6)
    table[-60:] = 0.75
    return np.asarray(cv2.GaussianBlur(np.clip(table, 0.03, 1), (0, 0), 1.0), dtype=np.float32)


def _cloud(rng: np.random.Generator, grain: float) -> Array:
    """Return smooth noise of unit variance, (_SIDE, _SIDE)."""
    cloud = cv2.GaussianBlur(rng.standard_normal((_SIDE, _SIDE)), (0, 0), grain, borderType=cv2.BORDER_REFLECT)
    return np.asarray(cloud / cloud.std(), dtype=np.float64)
