"""The renderer's optics: the PSF acts before the pixel, every camera model and bowed sheets land rightly."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, make_target
from boxcal.target.camera.camera_model import CameraKind, CameraModel, project
from boxcal.target.render.pictures import looking
from boxcal.target.render.rays import pixel_rays
from boxcal.target.render.renderer import FLAT, SensorModel, render

SIZE = (160, 120)
ZOOM = 4
SMOOTH = SensorModel(background="plain", psf_px=0.6)
CAMERAS = {
    "radial": CameraModel(fu=160.0, fv=161.0, cu=78.3, cv=61.7, kr=-0.2),
    "brown": CameraModel(
        fu=160.0, fv=161.0, cu=78.3, cv=61.7, kr=-0.28, k2=0.09, p1=2e-3, p2=-1.5e-3, k3=-0.01, kind=CameraKind.BROWN
    ),
    "rational": CameraModel(
        fu=160.0, fv=161.0, cu=78.3, cv=61.7, kr=0.3, k2=0.05, p1=1e-3, p2=-2e-3, k3=0.01, k4=0.4, k5=0.02, k6=0.003,
        kind=CameraKind.RATIONAL,
    ),
    "fisheye": CameraModel(
        fu=75.0, fv=75.5, cu=78.3, cv=61.7, kr=0.02, k2=-0.008, k3=0.003, k4=-7e-4, kind=CameraKind.FISHEYE
    ),
}  # fmt: skip
every_camera = pytest.mark.parametrize("camera", CAMERAS.values(), ids=list(CAMERAS))
POSE = looking(np.array([0.42, 0.21, 0.17]), np.array([0.02, 0.0, 0.1]))


def enlarged(camera: CameraModel, times: int) -> CameraModel:
    """The camera with pixels so many times smaller."""
    centre = [times * (c + 0.5) - 0.5 for c in (camera.cu, camera.cv)]
    return replace(camera, fu=times * camera.fu, fv=times * camera.fv, cu=centre[0], cv=centre[1])


@every_camera
def test_a_picture_is_the_scene_under_psf_and_pixel(camera: CameraModel) -> None:
    """Against pixels 4 times finer without PSF, blurred as light is, then summed over the coarse pixels."""
    picture = render(make_target(), camera, POSE, SIZE, SMOOTH).astype(float)
    fine = render(
        make_target(), enlarged(camera, ZOOM), POSE, (SIZE[0] * ZOOM, SIZE[1] * ZOOM), replace(SMOOTH, psf_px=0.0)
    ).astype(np.float32)
    expected = cv2.resize(cv2.GaussianBlur(fine, (0, 0), 0.6 * ZOOM), SIZE, interpolation=cv2.INTER_AREA)
    dimmer = render(make_target(), camera, POSE, SIZE, replace(SMOOTH, paper=0.4)).astype(float)
    box = cv2.erode((dimmer < picture).astype(np.uint8), np.ones((5, 5))) > 0  # the floor's horizon is not split
    box[:4], box[-4:], box[:, :4], box[:, -4:] = False, False, False, False  # nothing is known beyond ``fine``
    off = (picture - expected)[box]
    assert len(off) > 1500
    assert np.abs(off).max() < 3.5
    assert np.sqrt(np.mean(off**2)) < 0.5  # rounding to whole levels alone leaves 0.3


def test_blurring_pixels_after_their_integral_would_be_seen() -> None:
    """The fault that this renderer avoids is larger than the tolerance above."""
    camera = CAMERAS["radial"]
    wrong = cv2.GaussianBlur(render(make_target(), camera, POSE, SIZE, replace(SMOOTH, psf_px=0.0)), (0, 0), 0.6)
    right = render(make_target(), camera, POSE, SIZE, SMOOTH)
    assert np.abs(wrong.astype(float) - right).max() > 8


def edge_offset(picture: Array, uv_px: Array, normal: Array) -> float:
    """Mean distance, px, along ``normal``, of an edge in a picture from points (N, 2) on it: its centre of slope."""
    steps = np.arange(-3, 3.01, 0.05)
    where = uv_px[:, None] + steps[None, :, None] * normal
    u, v = (where[..., k].astype(np.float32) for k in (0, 1))
    profile = cv2.remap(picture.astype(np.float32), u, v, cv2.INTER_CUBIC).mean(axis=0)
    slope = np.abs(np.gradient(profile, steps))
    near = np.abs(steps) < 1.6
    return float(np.sum(slope[near] * steps[near]) / np.sum(slope[near]))


def outer_edges(corners_px: Array, p_box: Array, T_cam_box: Array, camera: CameraModel) -> list[tuple[Array, Array]]:
    """Points along each outer edge of a tag, and the edge's normal in the picture."""
    out = []
    for k in range(4):
        along = np.linspace(0.2, 0.8, 25)[:, None]
        p = p_box[k] + along * (p_box[(k + 1) % 4] - p_box[k])
        uv = project(camera, p @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        d = corners_px[(k + 1) % 4] - corners_px[k]
        out.append((uv, np.array([-d[1], d[0]]) / np.linalg.norm(d)))
    return out


@every_camera
def test_tags_edges_lie_where_the_camera_model_puts_them(camera: CameraModel) -> None:
    zoom = 7 if camera.kind is CameraKind.FISHEYE else ZOOM  # it sees the box smaller
    target, large = make_target(), enlarged(camera, zoom)
    picture = render(target, large, POSE, (zoom * SIZE[0], zoom * SIZE[1]), replace(SMOOTH, psf_px=0.5)).astype(float)
    off = []
    for tag in range(0, 35, 3):
        p_box = target.tag_corners[tag]
        corners = project(large, p_box @ POSE[:3, :3].T + POSE[:3, 3])
        off += [edge_offset(picture, uv, n) for uv, n in outer_edges(corners, p_box, POSE, large)]
    assert np.abs(off).max() < 0.06
    assert np.sqrt(np.mean(np.square(off))) < 0.02


def bowed(p_box: Array, face: int, sagitta: float) -> Array:
    """Points of a face (..., 3) on the sheet bowed outwards."""
    T = make_target().box.T_box_face(face)
    p_face = (p_box - T[:3, 3]) @ T[:3, :3]
    out = sagitta * (1 - (2 * p_face[..., 0] / 0.25) ** 2)
    return np.asarray(p_box + out[..., None] * T[:3, 2])


def test_bowed_faces_carry_their_tags_where_the_parabola_puts_them() -> None:
    target, large, sagitta = make_target(), enlarged(CAMERAS["radial"], ZOOM), 2e-3
    size = (ZOOM * SIZE[0], ZOOM * SIZE[1])
    pose = looking(np.array([0.30, 0.34, 0.22]), np.array([0.02, 0.0, 0.1]))
    picture = render(target, large, pose, size, replace(SMOOTH, psf_px=0.5), bow=(sagitta,) * FACES).astype(float)
    off, flat = [], []
    for tag in (8, 10, 12, 17, 22, 26, 43, 52, 59):
        p_box = bowed(target.tag_corners[tag], tag // 35, sagitta)
        corners = project(large, p_box @ pose[:3, :3].T + pose[:3, 3])
        edges = outer_edges(corners, p_box, pose, large)
        # vertical edges are straight on the parabola; the horizontal ones curve by less than 0.02 mm
        off += [edge_offset(picture, uv, n) for uv, n in edges]
        shift = corners - project(large, target.tag_corners[tag] @ pose[:3, :3].T + pose[:3, 3])
        flat.append(np.linalg.norm(shift, axis=1).max())
    assert max(flat) > 2, "the bow itself is far above the tolerance"
    assert np.abs(off).max() < 0.12
    assert np.sqrt(np.mean(np.square(off))) < 0.04


def test_a_flat_bow_changes_nothing() -> None:
    camera = CAMERAS["brown"]
    flat = render(make_target(), camera, POSE, SIZE, SMOOTH)
    np.testing.assert_array_equal(flat, render(make_target(), camera, POSE, SIZE, SMOOTH, bow=FLAT))
    almost = render(make_target(), camera, POSE, SIZE, SMOOTH, bow=(1e-9,) * FACES)
    assert np.abs(flat.astype(int) - almost).max() <= 1


def test_large_pictures_come_in_strips_without_seams(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = render(make_target(), CAMERAS["radial"], POSE, SIZE, SMOOTH)
    monkeypatch.setattr("boxcal.target.render.psf._STRIP", 1)
    np.testing.assert_array_equal(whole, render(make_target(), CAMERAS["radial"], POSE, SIZE, SMOOTH))


def test_pictures_of_unlike_motion_share_the_rays_of_their_pixels() -> None:
    camera = CameraModel(fu=211.0, fv=212.0, cu=63.0, cv=47.0, kr=-0.1)
    T_cam_box = np.array([[0, 1, 0, 0], [0, 0, -1, 0.1], [-1, 0, 0, 1], [0, 0, 0, 1]], dtype=np.float64)
    before = pixel_rays.cache_info().misses
    for motion in (0.5, 2.0, 5.0, 9.0, 14.0):
        render(make_target(), camera, T_cam_box, (128, 96), SensorModel(psf_px=0.6, motion_blur_px=motion))
    assert pixel_rays.cache_info().misses == before + 1
