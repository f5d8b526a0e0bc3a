"""Renderer of the box from any pose outside it, with edges right to a hundredth of a pixel.

A face is a sheet of black and white modules, so the mean of its ink over any rectangle of the sheet is exact from a
few look-ups (:mod:`boxcal.target.render.texture`). A pixel that lies within one colour needs one such mean; a pixel
that an edge crosses is split into samples, each the mean over its own footprint. The lens's PSF acts on the samples,
before they are gathered into pixels, as it acts on the light before it falls on a sensor.
"""

from dataclasses import replace
from math import ceil

import cv2
import numpy as np

from boxcal.target.arrays import Array, Image, Index, Reals
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraModel
from boxcal.target.errors import TargetError
from boxcal.target.render.background import background
from boxcal.target.render.psf import gather, reach_px
from boxcal.target.render.rays import Rays, pixel_rays
from boxcal.target.render.samples import Samples, batches, uniform_ink
from boxcal.target.render.sensor import SensorModel, expose
from boxcal.target.render.sides import Side, sides_seen
from boxcal.target.render.visibility import checked_pose, checked_size, visible_tags

__all__ = ["FLAT", "SensorModel", "encode_jpeg", "render", "visible_tags"]

FLAT = (0.0, 0.0, 0.0, 0.0)
"""Faces that are not bowed."""
_MARGINS_PX = 16


def render(  # noqa: PLR0917 - the noise source last, as a simulation's other steps have it
    target: Target,
    camera: CameraModel,
    T_cam_box: Array,
    image_size: tuple[int, int],
    sensor: SensorModel = SensorModel(),  # noqa: B008 - frozen
    rng: np.random.Generator | None = None,
    *,
    bow: tuple[float, float, float, float] = FLAT,
    T_cam_floor: Array | None = None,
) -> Image:
    """Return the grey image (H, W) that a camera takes of the box.

    Parameters
    ----------
    target
        The box. Its outline is that of its dimensions; the print on its faces follows ``tag_corners``.
    camera
        Intrinsics.
    T_cam_box : (4, 4), m
        Pose of the box before the camera.
    image_size
        (width, height), px.
    sensor
        Lens and sensor.
    rng
        Source of the noise; needed if the sensor has any.
    bow : m
        How far the middle of each face's sheet stands out from the plane of its tags' corners: a parabola over the
        face's width, zero at its upright edges.
    T_cam_floor : (4, 4), m, optional
        Pose of the floor (its z = 0) before the camera, where the box does not stand on it; only what is behind the
        box depends on it.

    Raises
    ------
    TargetError
        If the size or the pose is impossible, the camera is inside the box, or noise is asked for without ``rng``.
    """
    width, height = checked_size(image_size)
    T_cam_box = checked_pose(T_cam_box, target.box)
    if sensor.noise > 0 and rng is None:
        raise TargetError(
            f"noise is {sensor.noise:g} grey levels but no random generator was given",
            source="sensor",
            remedy="pass rng",
        )
    margin = _margin_px(sensor)
    wider = replace(camera, cu=camera.cu + margin, cv=camera.cv + margin)
    width, height = width + 2 * margin, height + 2 * margin
    rays = pixel_rays(wider, width, height)
    scene = _Scene(width * height)
    for side in sides_seen(target, T_cam_box, sensor, bow):
        scene.add(side, rays, sensor.supersample)
    T_cam_floor = T_cam_box if T_cam_floor is None else T_cam_floor
    behind = np.zeros(width * height, dtype=np.float32)
    if scene.least_cover() < 1:
        focal = (camera.fu + camera.fv) / 2
        room = sensor.background == "room"
        behind = background(
            rays.directions, (height, width), T_cam_floor, focal_px=focal, box=target.box, room=room
        ).ravel()
    coarse, at, fine = scene.over(behind)
    if rays.dark is not None:
        coarse[rays.dark] = 0
    intensity = gather(coarse.reshape(height, width), at, fine, sensor)
    return expose(intensity[margin : height - margin, margin : width - margin], sensor, rng)


def encode_jpeg(image: Image, quality: int = 90) -> bytes:
    """Return a grey or colour image as JPEG, quality 1 to 100.

    Raises
    ------
    TargetError
        If the quality is out of range or OpenCV cannot encode the image.
    """
    if not 1 <= quality <= 100:
        raise TargetError(f"JPEG quality is {quality}, 1 to 100 is needed")
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(quality)])
    if not done:
        raise TargetError(f"picture of shape {image.shape} and type {image.dtype}: cannot be encoded as JPEG")
    return bytes(data.tobytes())


def _margin_px(sensor: SensorModel) -> int:
    """Return how far beyond the image's border is rendered, px: light from there reaches into it.

    Of images on the move, each with a blur of its own, in steps, so that they share the rays of their pixels.
    """
    reach = reach_px(sensor)
    return _MARGINS_PX * ceil(reach / _MARGINS_PX) if sensor.motion_blur_px > 0 else reach


class _Scene:
    """Surface seen at each pixel, and at the samples of those pixels that an edge crosses."""

    def __init__(self, pixels: int) -> None:
        self.intensity = np.zeros(pixels, dtype=np.float32)
        self.cover = np.zeros(pixels, dtype=np.float32)
        self.parts: list[tuple[Index, Reals, Reals]] = []

    def add(self, side: Side, rays: Rays, supersample: int) -> None:
        """Add one side of the box."""
        inside, border = _regions(side, rays)
        self.intensity[inside], mixed = uniform_ink(side, rays, inside)
        self.cover[inside] = 1
        for at in batches(inside[mixed], supersample):
            intensity = Samples(rays, at, supersample).intensity(side)
            self.parts.append((at, intensity, np.ones_like(intensity)))
        for at in batches(border, supersample):
            samples = Samples(rays, at, supersample)
            coverage = samples.coverage(side.edges)
            self.parts.append((at, coverage * samples.intensity(side), coverage))

    def least_cover(self) -> float:
        """Return the smallest fraction of a pixel that the box covers."""
        cover = self.cover.copy()
        for at, _, coverage in self.parts:
            cover[at] = np.maximum(cover[at], coverage.min(axis=1))
        return float(cover.min())

    def over(self, behind: Reals) -> tuple[Reals, Index, Reals]:
        """Return the intensity (N,) of pixels before a background, the split ones (M,) and their samples (M, K)."""
        coarse = np.where(self.cover > 0, self.intensity, behind)
        if not self.parts:
            return coarse, np.zeros(0, dtype=np.intp), np.zeros((0, 1), dtype=np.float32)
        at, row = np.unique(np.concatenate([part[0] for part in self.parts]), return_inverse=True)
        samples, cover = (np.zeros((len(at), self.parts[0][1].shape[1]), dtype=np.float32) for _ in range(2))
        first = 0
        for part, intensity, coverage in self.parts:
            rows = row[first : first + len(part)]  # within a part each pixel stands once
            samples[rows] += intensity
            cover[rows] += coverage
            first += len(part)
        rest = np.where(self.cover[at, None] > 0, np.maximum(1 - cover, 0), 0)  # within another side of one colour
        samples += rest * self.intensity[at, None]
        cover += rest
        samples /= np.maximum(cover, 1)
        samples += np.maximum(1 - cover, 0) * behind[at, None]
        coarse[at] = samples.mean(axis=1)
        return coarse, at, samples


def _regions(side: Side, rays: Rays) -> tuple[Index, Index]:
    """Return the pixels that lie wholly within a side, and those that its outline may cross."""
    slopes = np.maximum(np.hypot(side.edges[:, 0], side.edges[:, 1]), np.float32(1e-12))
    depth = ((side.edges / slopes[:, None]) @ rays.directions).min(axis=0)
    inside = depth >= rays.reach
    border = (depth > -rays.reach) & ~inside
    if rays.dark is not None:
        inside &= ~rays.dark
        border &= ~rays.dark
    return np.flatnonzero(inside), np.flatnonzero(border)
