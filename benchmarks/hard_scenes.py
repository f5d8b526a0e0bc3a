"""Hard pictures with their truth: light, paper, lens and sensors that are unkind, for :mod:`hard_pictures`.

What acts on the light before it falls on pixels (spread ink, wrinkles, defocus, the sensor's mosaic) is made on a
image that is rendered three times finer without noise, then gathered into pixels; what acts afterwards, on pixels.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

from tag_scenes import TARGET, Grey, Scene, encoded, scenes  # isort: skip - sets one thread before numpy counts them

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from boxcal.target.arrays import Array
from boxcal.target.render.renderer import SensorModel
from boxcal.target.render.srgb import srgb_from_linear
from boxcal.target.tags.families import tag_modules

PLAIN = SensorModel(noise=2, psf_px=0.6)
ASPECTS = (0.75, 0.85, 0.92, 0.98)
"""Pixels that are not square, as anamorphic sensors and resized streams have them."""
FINER = 3
"""How much finer images are rendered in which ink spreads, paper wrinkles, or a sensor gathers light."""
Change = Callable[[Scene, np.random.Generator], Scene]


def shadow(scene: Scene, rng: np.random.Generator) -> Scene:
    """Put the darker part of an image behind a hard edge: a third of the light, the edge a pixel wide."""
    height, width = scene.image.shape
    y, x = np.mgrid[:height, :width]
    angle = rng.uniform(0.3, 1.2)
    middle = scene.uv_px[scene.wanted].mean(axis=(0, 1))
    side = (x - middle[0]) * np.cos(angle) + (y - middle[1]) * np.sin(angle)
    light = 0.33 + 0.67 / (1 + np.exp(-np.clip(side / 0.7, -50, 50)))
    return replace(scene, image=np.rint(scene.image * light).astype(np.uint8))


def glare(scene: Scene, rng: np.random.Generator) -> Scene:
    """Add a saturating highlight, 60 px wide, near the middle of the tags."""
    height, width = scene.image.shape
    y, x = np.mgrid[:height, :width]
    middle = scene.uv_px[scene.wanted].mean(axis=(0, 1)) + rng.uniform(-30, 30, 2)
    spot = 260 * np.exp(-0.5 * ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / 25.0**2)
    return replace(scene, image=np.clip(np.rint(scene.image + spot), 0, 255).astype(np.uint8))


def interlaced(scene: Scene, _: np.random.Generator) -> Scene:
    """Take the two fields of an image half a frame apart, the box 2 px further right in the second; truth midway."""
    fields = [cv2.warpAffine(scene.image, np.array([[1.0, 0, side], [0, 1, 0]]), None) for side in (-1.0, 1.0)]
    image = fields[0].copy()
    image[1::2] = fields[1][1::2]
    return replace(scene, image=image)


def finer(
    views: int,
    seed: int,
    *,
    light: Change | None = None,
    sensor: Callable[[Array, np.random.Generator], Array] | None = None,
    psf_px: float = 0.6,
    noise: float = 2.0,
) -> list[Scene]:
    """Return views made on finer images.

    ``light`` changes the finer image and its truth, ``sensor`` the light (H, W), 0..1, that pixels have gathered.
    """
    fine = scenes(views, seed=seed, scale=FINER, sensor=SensorModel(psf_px=psf_px * FINER))
    rng, made = np.random.default_rng(seed), []
    for scene in fine:
        changed = light(scene, rng) if light else scene
        gathered = cv2.resize(changed.image / 255, None, fx=1 / FINER, fy=1 / FINER, interpolation=cv2.INTER_AREA)
        grey = 255 * (sensor(gathered, rng) if sensor else gathered)
        image = np.clip(np.rint(grey + noise * rng.normal(size=grey.shape)), 0, 255).astype(np.uint8)
        uv = (changed.uv_px + 0.5) / FINER - 0.5
        made.append(replace(changed, image=image, uv_px=uv, width_px=changed.width_px / FINER))
    return made


def resampled(image: Grey, x: Array, y: Array) -> Grey:
    """Return a picture with the grey levels that another has at places (H, W), px, by its quintic spline.

    OpenCV's cubic kernel displaces what it interpolates by up to 0.05 px, and rounds places to 1/32 px.
    """
    levels = map_coordinates(image.astype(np.float32), np.stack([y, x]), order=5, mode="nearest")
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def bled(scene: Scene, _: np.random.Generator) -> Scene:
    """Let ink spread by a tenth of a pixel into the paper; corners are where they were meant."""
    spread = 0.7 * scene.image + 0.3 * cv2.erode(scene.image, np.ones((3, 3), np.uint8))
    return replace(scene, image=spread)


def defocused(scene: Scene, _: np.random.Generator) -> Scene:
    """Spread every point to a disc 3 px wide."""
    radius = 1.5 * FINER
    y, x = np.mgrid[-5:6, -5:6]
    disc = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1)
    return replace(scene, image=cv2.filter2D(scene.image.astype(np.float32), -1, disc / disc.sum()))


def wrinkled(scene: Scene, rng: np.random.Generator, height_mm: float = 0.4, length: float = 0.5) -> Scene:
    """Displace the image as paper does that stands off its face in waves, 0.4 mm high (rms) and as long as a tag.

    Waves are white noise that is smoothed by a Gaussian of ``length`` sides of a tag. Seen 30 degrees off its normal
    such paper moves by half its height; corners are where they are printed.
    """
    side = float(np.median(scene.width_px[scene.wanted]))
    shift = 0.5e-3 * height_mm / TARGET.box.tag_size * side
    height, width = scene.image.shape
    waves = cv2.GaussianBlur(rng.normal(size=(height // 8, width // 8)), (0, 0), length * side / 8)
    waves = cv2.resize(waves * shift / waves.std(), (width, height), interpolation=cv2.INTER_CUBIC).astype(np.float32)
    angle = rng.uniform(0, 2 * np.pi)
    way = np.array([np.cos(angle), np.sin(angle)], dtype=np.float32)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    image = resampled(scene.image, x + waves * way[0], y + waves * way[1])
    uv = scene.uv_px
    for _ in range(3):
        at = np.nan_to_num(uv)
        moved = map_coordinates(waves, [at[..., 1], at[..., 0]], order=3, mode="nearest")
        uv = scene.uv_px - moved[..., None] * way
    return replace(scene, image=image, uv_px=uv)


def gamma(light: Array, _: np.random.Generator) -> Array:
    """Apply a pure power law, 1 / 2.2, which is neither of the curves that the detector knows."""
    return np.asarray(np.clip(light, 0, 1) ** (1 / 2.2))


def contrasty(light: Array, _: np.random.Generator) -> Array:
    """Apply sRGB's curve and the S-shaped one of a camera's picture style on top."""
    grey = np.asarray(srgb_from_linear(np.clip(light, 0, 1)), dtype=np.float64)
    return np.asarray(grey + 0.35 * grey * (1 - grey) * (2 * grey - 1))


def dark(light: Array, rng: np.random.Generator) -> Array:
    """Take the image with 300 electrons at white, 4 electrons of read noise: gain makes it bright again."""
    electrons = rng.poisson(300 * np.clip(light, 0, 1)) + 4 * rng.normal(size=light.shape)
    return np.asarray(electrons / 300)


def mosaic(light: Array, _: np.random.Generator) -> Array:
    """Gather the light behind red, green and blue filters under a warm lamp; sent as if it were grey."""
    out = light * 0.9
    out[::2, ::2] *= 0.75
    out[1::2, 1::2] *= 0.45
    return np.asarray(out)


def rolling(scene: Scene, _: np.random.Generator) -> Scene:
    """Shear an image by 3 px from its top to its bottom row, as a shutter that rolls does; corners move along."""
    height, width = scene.image.shape
    by_row = 3.0 / height * FINER
    y, x = np.mgrid[:height, :width].astype(np.float32)
    image = resampled(scene.image, x - by_row * (y - height / 2), y)
    uv = scene.uv_px.copy()
    uv[..., 0] += by_row * (uv[..., 1] - height / 2)
    return replace(scene, image=image, uv_px=uv)


def posters(scene: Scene, rng: np.random.Generator) -> Scene:
    """Hang prints of two faces, enlarged, on a wall behind the box, to its left and right."""
    height, width = scene.image.shape
    print_of = [_print(int(face)) for face in rng.permutation(4)[:2]]
    box = cv2.convexHull(scene.uv_px.reshape(-1, 2).astype(np.float32))[:, 0]
    middle = box.mean(axis=0)
    behind = cv2.fillConvexPoly(
        np.zeros_like(scene.image), np.rint(middle + 1.3 * (box - middle)).astype(np.int32), 255
    )
    image = scene.image.copy()
    for sheet, left in zip(print_of, (10.0, width / 2 + 10.0), strict=True):
        rows, columns = sheet.shape
        wide = width / 2 - 20
        quad = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (wide, wide * rows / columns)
        quad += np.array([left, (height - quad[2, 1]) / 2]) + rng.uniform(-9, 9, (4, 2))
        corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32)
        H = cv2.getPerspectiveTransform(corners, quad.astype(np.float32))
        drawn = cv2.warpPerspective(sheet, H, (width, height), borderValue=0)
        seen = cv2.warpPerspective(np.full_like(sheet, 255), H, (width, height)) == 255
        image = np.where(seen & (behind == 0), drawn, image)
    return replace(scene, image=image)


def _print(face: int) -> Grey:
    """Return a face as its sheet is printed, with tags 56 px wide."""
    T = TARGET.T_box_face(face)
    rows = np.flatnonzero(TARGET.tag_faces == face)
    p = ((TARGET.tag_corners[rows] - T[:3, 3]) @ T[:3, :3])[..., :2] * (
        56 / TARGET.box.tag_size,
        -56 / TARGET.box.tag_size,
    )
    p = np.rint(p - p.min(axis=(0, 1)) + 16).astype(int)
    sheet = np.full(p.max(axis=(0, 1))[::-1] + 16, 215, np.uint8)
    for tag, corners in zip(TARGET.tag_ids[rows], p, strict=True):
        modules = np.where(tag_modules(TARGET.box.dictionary, int(tag)), 215, 13).astype(np.uint8)
        side = corners[1, 0] - corners[0, 0]
        (x, y), shape = corners[0], (side, side)
        sheet[y : y + side, x : x + side] = cv2.resize(modules, shape, interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(sheet, (0, 0), 1.2).astype(np.uint8)


def rendered(views: int, first_seed: int = 140) -> Iterator[tuple[str, Callable[[], list[Scene]]]]:
    """Yield the names of sets of rendered views, and what makes them; seeds run from the first one."""
    plain = {"sensor": PLAIN}
    yield "hard shadow", lambda: scenes(views, seed=first_seed + 1, change=shadow, **plain)
    yield "highlight", lambda: scenes(views, seed=first_seed + 2, change=glare, **plain)
    for length, seed in ((1.0, 20), (2.0, 3), (3.0, 4)):
        blurred = replace(PLAIN, motion_blur_px=length, motion_angle=0.6)
        yield f"motion {length:g} px", lambda b=blurred, s=seed: scenes(views, seed=first_seed + s, sensor=b)
    yield "no blur", lambda: scenes(views, seed=first_seed + 5, sensor=replace(PLAIN, psf_px=0.0))
    yield "defocus, 3 px wide", lambda: finer(views, first_seed + 10, light=defocused, psf_px=0.3)
    yield "noise 6", lambda: scenes(views, seed=first_seed + 11, sensor=replace(PLAIN, noise=6))
    yield "dark, noise of gain", lambda: finer(views, first_seed + 12, sensor=dark, noise=0.5)
    yield "ink bleed", lambda: finer(views, first_seed + 7, light=bled)
    yield "wrinkled paper", lambda: finer(views, first_seed + 13, light=wrinkled)
    yield "interlaced, 2 px", lambda: scenes(views, seed=first_seed + 9, change=interlaced, **plain)
    yield "rolling shutter, 3 px", lambda: finer(views, first_seed + 14, light=rolling)
    yield "raw mosaic as mono8", lambda: finer(views, first_seed + 15, sensor=mosaic)
    for aspect in ASPECTS:
        yield f"fv/fu {aspect:g}", lambda a=aspect: scenes(views, seed=first_seed + 8, aspect=a, **plain)
    yield "gamma 2.2", lambda: finer(views, first_seed + 16, sensor=gamma)
    yield "sRGB, contrasty", lambda: finer(views, first_seed + 17, sensor=contrasty)
    yield (
        "sRGB JPEG 85",
        lambda: scenes(views, seed=first_seed + 6, sensor=replace(PLAIN, srgb=True), change=encoded(85)),
    )
    yield "JPEG 60", lambda: scenes(views, seed=first_seed + 18, change=encoded(60), **plain)
    yield (
        "prints on a wall",
        lambda: scenes(
            views, seed=first_seed + 21, change=posters, distances=(0.8, 1.1), widths=(11.0, 1e9), faces=2, **plain
        ),
    )
    yield "clean", lambda: scenes(views, seed=first_seed + 19, sensor=SensorModel(noise=0.5, psf_px=0.7))
