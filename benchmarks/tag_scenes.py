"""Images of the default box with their truth, and images without one of its tags, for the detectors' benchmarks.

To be imported before numpy: holds this process to one thread.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import cv2  # noqa: E402
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from boxcal.target.arrays import Array  # noqa: E402
from boxcal.target.box import make_target  # noqa: E402
from boxcal.target.camera.camera_model import CameraModel, project  # noqa: E402
from boxcal.target.render.renderer import SensorModel, encode_jpeg, render, visible_tags  # noqa: E402
from boxcal.target.tags.families import load_dictionary  # noqa: E402

Grey = NDArray[np.uint8]
TARGET = make_target()


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One image with its truth: ids that ought to be found, and where every tag's corners are."""

    image: Grey
    wanted: NDArray[np.int64]
    uv_px: Array
    width_px: Array
    covered: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


def pose(rng: np.random.Generator, near: float, far: float) -> tuple[Array, Array]:
    """Return a camera's T_cam_box at a random distance from a face, 0 to 60 deg off its normal, and that normal."""
    distance, angle, turn = rng.uniform(near, far), np.deg2rad(rng.uniform(0, 60)), rng.uniform(0, 2 * np.pi)
    T_box_face = TARGET.box.T_box_face(int(rng.integers(4)))
    way = np.array([np.sin(angle) * np.cos(turn), abs(np.sin(angle) * np.sin(turn)), np.cos(angle)])
    centre = T_box_face[:3, :3] @ (way * distance) + T_box_face[:3, 3]
    aim = T_box_face[:3, 3] + T_box_face[:3, :3] @ np.array([*rng.uniform(-0.05, 0.05, 2), 0])
    z = (aim - centre) / np.linalg.norm(aim - centre)
    x = np.cross(z, (0, 0, 1.0))
    x /= np.linalg.norm(x)
    roll = rng.uniform(-0.26, 0.26)
    R = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3] = R @ np.stack([x, np.cross(z, x), z])
    T[:3, 3] = -T[:3, :3] @ centre
    return T, centre


def width_px(corners: Array) -> Array:
    """Return the shorter distance across tags (N, 4, 2), (N,) px."""
    a, b = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    side = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    return np.asarray(0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / np.maximum(side, 1e-9))


def scenes(
    views: int,
    *,
    seed: int = 1,
    scale: float = 1.0,
    size: tuple[int, int] | None = None,
    focal: float = 800.0,
    distances: tuple[float, float] = (0.4, 1.2),
    widths: tuple[float, float] = (16.0, 1e9),
    sensor: SensorModel = SensorModel(noise=2, psf_px=0.6),  # noqa: B008 - frozen
    kr: float = -0.1,
    aspect: float = 1.0,
    faces: int = 1,
    change: Callable[[Scene, np.random.Generator], Scene] | None = None,
) -> list[Scene]:
    """Return rendered views of the default box; wanted are tags on faces seen within 60 deg, of those widths.

    ``size`` is the image's (4 : 3 at ``scale`` if None), ``aspect`` is fv over fu; wanted tags lie on a number of
    ``faces`` at least.
    """
    size = size or (round(640 * scale), round(480 * scale))
    rng = np.random.default_rng(seed)
    made = []
    while len(made) < views:
        camera = CameraModel(
            fu=focal * scale,
            fv=aspect * focal * scale,
            cu=size[0] / 2 + 9 * scale,
            cv=size[1] / 2 - 7 * scale,
            kr=kr,
        )
        T_cam_box, centre = pose(rng, *distances)
        uv = project(camera, TARGET.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        seen = visible_tags(TARGET, camera, T_cam_box, size, 2.0)
        width = width_px(uv)
        normals = np.stack([TARGET.box.T_box_face(int(f))[:3, 2] for f in TARGET.tag_faces[seen]])
        ray = centre - TARGET.tag_corners[seen].mean(axis=1)
        steep = np.einsum("ni,ni->n", normals, ray / np.linalg.norm(ray, axis=1, keepdims=True)) < 0.5
        wanted = seen[~steep & (width[seen] >= widths[0] * scale) & (width[seen] < widths[1] * scale)]
        if len(np.unique(TARGET.tag_faces[wanted])) < faces:
            continue
        image = render(TARGET, camera, T_cam_box, size, sensor, rng)
        scene = Scene(image=image, wanted=wanted, uv_px=uv, width_px=width)
        made.append(change(scene, rng) if change else scene)
    return made


def encoded(quality: int) -> Callable[[Scene, np.random.Generator], Scene]:
    """Return what encodes images as JPEG and decodes them again."""

    def jpeg_of(scene: Scene, _: np.random.Generator) -> Scene:
        data = np.frombuffer(encode_jpeg(scene.image, quality), np.uint8)
        return replace(scene, image=np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8))

    return jpeg_of


jpeg = encoded(85)


def cover_half(scene: Scene, rng: np.random.Generator) -> Scene:
    """Hide half of what is wanted behind a textured board; tags that it touches are no longer wanted."""
    corners = scene.uv_px[scene.wanted]
    edge = float(np.median(corners[..., 0]))
    image = scene.image.copy()
    board = cv2.GaussianBlur(rng.uniform(0, 255, image.shape).astype(np.float32), (0, 0), 2)
    board = np.clip(128 + 6 * (board - 128), 0, 255)
    column = int(edge)
    image[:, column:] = board[:, column:].astype(np.uint8)
    reach = corners[..., 0].max(axis=1) > column - 3
    hidden = np.flatnonzero(scene.uv_px[..., 0].min(axis=1) > column)
    return replace(scene, image=image, wanted=scene.wanted[~reach], covered=hidden)


def tagless(count: int, seed: int = 7) -> list[Grey]:
    """Return images without a tag of the target: clutter, text, grids, and tags of other families or ids."""
    rng = np.random.default_rng(seed)
    families = ["DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9"]
    families += ["DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11", "DICT_ARUCO_ORIGINAL"]
    makers = [_clutter, _text, _grid, lambda r: _others(r, families[int(r.integers(len(families)))])]
    images = []
    for k in range(count):
        image = makers[k % len(makers)](rng).astype(np.float32)
        image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0, 2, image.shape)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return images


def _clutter(rng: np.random.Generator) -> Array:
    image = np.full((480, 640), float(rng.uniform(60, 220)))
    for _ in range(int(rng.integers(80, 400))):
        points = rng.uniform(0, (640, 480), 2) + rng.normal(0, rng.uniform(4, 60), (int(rng.integers(3, 7)), 2))
        cv2.fillPoly(image, [points.astype(np.int32)], float(rng.uniform(0, 255)))
    return image


def _text(rng: np.random.Generator) -> Array:
    image = np.full((480, 640), 235, np.uint8)
    letters = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789#@%&[]"))
    for row in range(10, 480, int(rng.integers(9, 40))):
        line = "".join(rng.choice(letters, 60))
        size = float(rng.uniform(0.25, 1.5))
        cv2.putText(
            image, line, (4, row), int(rng.integers(0, 6)), size, float(rng.uniform(0, 90)), int(rng.integers(1, 4))
        )
    return image.astype(np.float64)


def _grid(rng: np.random.Generator) -> Array:
    """Return a warped board of framed squares with random modules between."""
    module = int(rng.integers(2, 7))
    cells = np.kron(
        rng.random((480 // module + 1, 640 // module + 1)) < rng.uniform(0.3, 0.7), np.ones((module, module))
    )
    image = np.where(cells[:480, :640] > 0, 20.0, 230.0)
    pitch = module * int(rng.integers(8, 12))
    for y in range(0, 480, pitch):
        for x in range(0, 640, pitch):
            cv2.rectangle(image, (x, y), (x + pitch - 1, y + pitch - 1), 235.0, module)
            cv2.rectangle(
                image, (x + module, y + module), (x + pitch - 1 - module, y + pitch - 1 - module), 15.0, module
            )
    corners = np.array([[0, 0], [640, 0], [640, 480], [0, 480]], np.float32)
    H = cv2.getPerspectiveTransform(corners, (corners + rng.uniform(-90, 90, (4, 2))).astype(np.float32))
    return np.asarray(cv2.warpPerspective(image, H, (640, 480), borderValue=128.0), dtype=np.float64)


def _others(rng: np.random.Generator, family: str) -> Array:
    image = np.full((480, 640), 225.0)
    dictionary = load_dictionary(family)
    first = TARGET.tag_ids.size if family == TARGET.box.dictionary else 0
    side = int(rng.integers(16, 70))
    for y in range(8, 480 - side - 8, side + max(6, side // 4)):
        for x in range(8, 640 - side - 8, side + max(6, side // 4)):
            tag = int(rng.integers(first, dictionary.bytesList.shape[0]))
            image[y : y + side, x : x + side] = cv2.aruco.generateImageMarker(dictionary, tag, side)
    return image
