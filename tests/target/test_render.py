"""The renderer against geometry, against plain ray tracing, and before OpenCV's detector."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from boxcal.target.arrays import Array
from boxcal.target.box import Box, Target, make_target
from boxcal.target.camera.camera_model import CameraModel, project, unproject
from boxcal.target.errors import TargetError
from boxcal.target.render.renderer import SensorModel, encode_jpeg, render, visible_tags
from boxcal.target.tags.families import modules_per_side, tag_modules

SIZE = (1280, 960)
CAMERA = CameraModel(fu=1200.0, fv=1212.0, cu=637.3, cv=483.8, kr=-0.15)
SMALL, SMALL_CAMERA = (160, 120), CameraModel(fu=150.0, fv=151.0, cu=79.2, cv=61.3, kr=-0.15)
TINY = (96, 72)
PAPER, INK, SHADE = 200 / 255, 10 / 255, (1.0, 0.9, 0.8, 0.95, 0.5)
EXACT = SensorModel(paper=PAPER, ink=INK, shade=SHADE, background="plain")
"""Levels that are whole grey levels on every face, so that rounding adds no bias."""


def look_at(
    eye: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0.1), roll_deg: float = 0
) -> Array:
    z = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
    x = np.cross(z, (0, 0, 1)) / np.linalg.norm(np.cross(z, (0, 0, 1)))
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.stack([x, np.cross(z, x), z])
    T[:3, 3] = -T[:3, :3] @ eye
    return T


POSES = {
    "front": look_at((0.5, 0.03, 0.14)),
    "corner": look_at((0.36, 0.31, 0.25)),
    "rolled": look_at((-0.31, 0.31, 0.2), roll_deg=10),
    "low": look_at((0.1, -0.45, 0.05)),
}


def to_cam(T_cam_box: Array, p_box: Array) -> Array:
    return np.asarray(p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])


def edge_offsets(image: NDArray[np.uint8], uv_px: Array, reach_px: int = 4) -> Array:
    """Return how far an edge lies from the curve uv_px (N, 2) in each row (or column) that it crosses, px.

    Under a box-filter pixel, the sum along a scan line across one edge between two plain areas gives its position.
    """
    if np.ptp(uv_px[:, 0]) > np.ptp(uv_px[:, 1]):
        image, uv_px = image.T, uv_px[:, ::-1]
    uv_px = uv_px[np.argsort(uv_px[:, 1])]
    found = []
    for v in range(int(np.ceil(uv_px[0, 1] + 2)), int(uv_px[-1, 1] - 2) + 1):
        within = np.interp(v + np.linspace(-0.5, 0.5, 11), uv_px[:, 1], uv_px[:, 0]).mean()
        first = round(within) - reach_px
        if first < 0 or first + 2 * reach_px >= image.shape[1] or v >= image.shape[0]:
            continue
        line = image[v, first : first + 2 * reach_px + 1].astype(float)
        begin, end = line[:2], line[-2:]
        assert np.ptp(begin) == 0, "the scan line begins on another edge"
        assert np.ptp(end) == 0, "the scan line ends on another edge"
        assert abs(end[0] - begin[0]) > 15, "there is no edge here"
        found.append(first - 0.5 + (line - end[0]).sum() / (begin[0] - end[0]) - within)
    return np.array(found)


def tag_edge_offsets(target: Target, T_cam_box: Array) -> Array:
    """Return the mean offset of each visible tag's four outer edges, px; only edges of large, upright modules count."""
    image = render(target, CAMERA, T_cam_box, SIZE, EXACT)
    means = []
    for tag in visible_tags(target, CAMERA, T_cam_box, SIZE, margin_px=8):
        corners = target.tag_corners[target.row_of(tag)]
        sides = np.linalg.norm(np.diff(project(CAMERA, to_cam(T_cam_box, corners)), axis=0), axis=1)
        if sides.min() < 8 * 5.6:
            continue
        for k in range(4):
            along = np.linspace(0.12, 0.88, 60)[:, None]
            p_box = corners[k] + along * (corners[(k + 1) % 4] - corners[k])
            offsets = edge_offsets(image, project(CAMERA, to_cam(T_cam_box, p_box)), reach_px=3)
            means.append(offsets.mean())
    assert len(means) >= 40
    return np.array(means)


def traced(target: Target, camera: CameraModel, T_cam_box: Array, size: tuple[int, int]) -> tuple[Array, Array]:
    """Return the grey level and the coverage (H, W) by plain ray tracing.

    A Fibonacci lattice of 233 rays a pixel, so that an edge in any direction is met evenly. Nothing of the renderer's.
    """
    box, modules = target.box, modules_per_side(target.box.dictionary)
    inked = ~np.array([tag_modules(box.dictionary, int(tag)) for tag in target.tag_ids])
    k = np.arange(233)
    lattice = np.stack([(k + 0.5) / 233, (k * 144 / 233 + 0.5 / 233) % 1], -1) - 0.5
    pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1)[:, :, None]
    xy = unproject(camera, pixels + lattice)
    direction = np.concatenate([xy, np.ones((*xy.shape[:3], 1))], -1) @ T_cam_box[:3, :3]
    eye = -T_cam_box[:3, :3].T @ T_cam_box[:3, 3]
    low, high = np.array([-box.width / 2, -box.depth / 2, 0]), np.array([box.width / 2, box.depth / 2, box.height])
    with np.errstate(divide="ignore"):
        hits = np.sort([(low - eye) / direction, (high - eye) / direction], axis=0)
    near, far = hits[0].max(-1), hits[1].min(-1)
    hit = (near > 0) & (near < far)
    side_axis = hits[0].argmax(-1)
    p = eye + np.where(hit, near, 0)[..., None] * direction
    level = np.zeros(hit.shape)
    for side in range(5):
        axis, sign = (0, 1, 0, 1, 2)[side], (1, 1, -1, -1, 1)[side]
        here = hit & (side_axis == axis) & (np.sign(p[..., axis] - (low + high)[axis] / 2) == sign)
        if not here.any():
            continue
        ink = np.zeros(here.sum(), dtype=bool)
        if side < 4:
            p_face = (p[here] - box.T_box_face(side)[:3, 3]) @ box.T_box_face(side)[:3, :3]
            corner = box.grid_corners()[0, 0]
            du, dv = p_face[:, 0] - corner[0], corner[1] - p_face[:, 1]
            col, row = np.floor(du / box.pitch).astype(int), np.floor(dv / box.pitch).astype(int)
            i = np.floor((du - col * box.pitch) / box.tag_size * modules).astype(int)
            j = np.floor((dv - row * box.pitch) / box.tag_size * modules).astype(int)
            ok = (i < modules) & (j < modules) & (col >= 0) & (row >= 0) & (col < box.columns) & (row < box.rows)
            tag = side * box.tags_a_face + row[ok] * box.columns + col[ok]
            ink[ok] = inked[tag, j[ok], i[ok]]
        level[here] = 255 * SHADE[side] * np.where(ink, INK, PAPER)
    return level.mean(2), hit.mean(2)


def detect(image: NDArray[np.uint8]) -> dict[int, Array]:
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    corners, ids, _ = detector.detectMarkers(image)
    return (
        {}
        if ids is None
        else {int(i): np.asarray(c, dtype=float).reshape(4, 2) for i, c in zip(np.ravel(ids), corners, strict=True)}
    )


@pytest.mark.parametrize("pose", POSES)
def test_tag_edges_lie_where_geometry_puts_them(pose: str) -> None:
    offsets = tag_edge_offsets(make_target(), POSES[pose])
    assert np.abs(offsets).max() < 0.01
    assert np.abs(offsets.mean()) < 0.001


def test_edge_measure_sees_a_hundredth_of_a_pixel() -> None:
    moved = POSES["front"].copy()
    image = render(make_target(), CAMERA, moved, SIZE, EXACT)
    edge = np.linspace((0.125, -0.119, 0.18), (0.125, -0.119, 0.16), 50)
    truth = project(CAMERA, to_cam(moved, edge))
    assert edge_offsets(image, truth + np.array([0.02, 0]), reach_px=3).mean() == pytest.approx(-0.02, abs=0.004)


@pytest.mark.parametrize(
    ("ends", "pose"),
    [
        (((0.125, -0.125, 0.12), (0.125, -0.125, 0.195)), look_at((0.5, 0.03, 0.08))),
        (((0.125, -0.12, 0.2), (0.125, 0.12, 0.2)), look_at((0.5, 0.03, 0.08), roll_deg=12)),
        (((0.125, 0.125, 0.01), (0.125, 0.125, 0.19)), look_at((0.36, 0.31, 0.25))),
        (((0.125, -0.12, 0.2), (0.125, 0.12, 0.2)), look_at((0.36, 0.31, 0.45))),
    ],
    ids=["face-wall", "face-wall-above", "face-face", "face-top"],
)
def test_outline_lies_where_geometry_puts_it(ends: tuple[Array, Array], pose: Array) -> None:
    image = render(make_target(), CAMERA, pose, SIZE, EXACT)
    uv_px = project(CAMERA, to_cam(pose, np.linspace(*ends, 200)))
    offsets = edge_offsets(image, uv_px)
    assert len(offsets) > 60
    assert np.abs(offsets).max() < 0.03
    assert np.abs(offsets.mean()) < 0.01


def print_at(target: Target, scale: float, down: float) -> Target:
    """Return the target with each face's sheet printed at a scale about the face's centre and glued too low, m."""
    faces = np.array([target.box.T_box_face(int(f))[:3, 3] for f in target.tag_faces])[:, None]
    return replace(target, tag_corners=faces + scale * (target.tag_corners - faces) - (0, 0, down))


@pytest.mark.parametrize(("scale", "down"), [(0.996, 0.0), (1.0, 0.0005)], ids=["99.6 %", "0.5 mm low"])
def test_print_follows_the_tags_actual_corners(scale: float, down: float) -> None:
    actual = print_at(make_target(), scale, down)
    offsets = tag_edge_offsets(actual, POSES["front"])
    assert np.abs(offsets).max() < 0.01
    assert np.abs(offsets.mean()) < 0.001
    shift = project(CAMERA, to_cam(POSES["front"], actual.tag_corners[:35])) - project(
        CAMERA, to_cam(POSES["front"], make_target().tag_corners[:35])
    )
    assert np.abs(shift).max() > 1, "the change itself is far above the tolerance"


def test_tilted_sheet_keeps_its_corners() -> None:
    target = make_target()
    c, s = np.cos(np.radians(0.5)), np.sin(np.radians(0.5))
    tilted = (target.tag_corners - (0.125, 0, 0.1)) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) + (0.1255, 0, 0.1)
    offsets = tag_edge_offsets(replace(target, tag_corners=tilted), POSES["front"])
    assert np.abs(offsets).max() < 0.01


@pytest.mark.parametrize(
    ("pose", "kr", "box"),
    [
        (look_at((0.42, 0.2, 0.2)), -0.15, Box()),
        (look_at((0.3, 0.3, 0.34), roll_deg=63), 0.2, Box()),
        (look_at((0.16, 0.02, 0.1), at=(0, 0.05, 0.12)), -0.2, Box()),
        (look_at((0.14, -0.11, 0.12), at=(0.13, 0.3, 0.1)), 0.0, Box()),
        (look_at((0.5, 0.2, 0.2), at=(0.1, 0.1, 0.1)), -0.15, Box(width=0.2, depth=0.3, pitch=0.039, columns=4)),
        (look_at((1.6, 1.3, 0.5)), 0.0, Box()),
        (look_at((0.5, 0.3, 0.2)), 0.1, Box(columns=3, rows=2, tag_size=0.06, pitch=0.071, dictionary="DICT_4X4_250")),
    ],
    ids=["two faces", "rolled, from above", "close", "face partly behind the camera", "other box", "far", "other tags"],
)
def test_picture_agrees_with_plain_ray_tracing(pose: Array, kr: float, box: Box) -> None:
    target, camera = make_target(box), replace(SMALL_CAMERA, cu=48.2, cv=35.7, kr=kr)
    fine = replace(EXACT, supersample=8)
    picture = render(target, camera, pose, TINY, fine).astype(float)
    level, cover = traced(target, camera, pose, TINY)
    whole, out = cover == 1, cover == 0
    off = (picture - level)[whole]
    assert whole.sum() > 300
    assert np.abs(off).max() < 8
    assert np.abs(off.mean()) < 4 * off.std() / np.sqrt(off.size)
    assert off.std() < 1.5
    dimmer = render(target, camera, pose, TINY, replace(fine, paper=PAPER / 2, ink=INK / 2)).astype(float)
    assert (dimmer[out] == picture[out]).all()
    assert (dimmer[whole] < picture[whole]).all()


def test_four_samples_a_side_are_as_good_as_sixteen() -> None:
    for pose in POSES.values():
        four, sixteen = (
            render(make_target(), SMALL_CAMERA, pose, SMALL, SensorModel(supersample=s)).astype(int) for s in (4, 16)
        )
        off = np.abs(four - sixteen)
        assert off.max() <= 6
        assert off.mean() < 0.1


@pytest.mark.parametrize(
    "sensor", [SensorModel(), SensorModel(noise=3, psf_px=0.8, vignetting=0.3, srgb=True, motion_blur_px=1)]
)
@pytest.mark.parametrize("pose", POSES)
def test_detector_reads_every_visible_tag_upright(pose: str, sensor: SensorModel) -> None:
    target = make_target()
    image = render(target, CAMERA, POSES[pose], SIZE, sensor, np.random.default_rng(1))
    found = detect(image)
    wanted = visible_tags(target, CAMERA, POSES[pose], SIZE, margin_px=3)
    assert len(wanted) >= 35
    # Versions of the detector differ in a few tags with modules of about 3 px in degraded pictures.
    assert set(found) <= set(wanted.tolist())
    assert len(found) >= (1.0 if sensor == SensorModel() else 0.94) * len(wanted)
    for tag, uv_px in found.items():
        truth = project(CAMERA, to_cam(POSES[pose], target.tag_corners[target.row_of(tag)]))
        assert np.abs(uv_px - truth).max() < 4


@pytest.mark.parametrize(
    ("eye", "face"), [((0.7, 0, 0.1), 0), ((0, 0.7, 0.1), 1), ((-0.7, 0, 0.1), 2), ((0, -0.7, 0.1), 3)]
)
def test_each_side_shows_its_own_face_only(eye: tuple[float, float, float], face: int) -> None:
    target, T_cam_box = make_target(), look_at(eye)
    ids = list(range(35 * face, 35 * face + 35))
    assert visible_tags(target, CAMERA, T_cam_box, SIZE).tolist() == ids
    assert sorted(detect(render(target, CAMERA, T_cam_box, SIZE))) == ids


def test_tags_beyond_the_border_are_not_visible() -> None:
    target, T_cam_box = make_target(), look_at((0.25, 0, 0.1))
    uv_px = project(CAMERA, to_cam(T_cam_box, target.tag_corners[:35]))
    for margin in (0.0, 40.0):
        low, high = margin - 0.5, np.array(SIZE) - 0.5 - margin
        inside = np.flatnonzero(((uv_px >= low) & (uv_px <= high)).all(axis=(1, 2)))
        assert 0 < len(inside) < 35
        assert visible_tags(target, CAMERA, T_cam_box, SIZE, margin).tolist() == inside.tolist()


def test_tags_folded_back_by_the_distortion_are_not_visible() -> None:
    folding = replace(SMALL_CAMERA, fu=40.0, fv=40.0, kr=-1.2)
    target, T_cam_box = make_target(), look_at((0.18, 0, 0.1))
    limit = 1 / np.sqrt(3 * 1.2)
    p_cam = to_cam(T_cam_box, target.tag_corners[:35])
    rho = np.linalg.norm(p_cam[..., :2] / p_cam[..., 2:], axis=-1).max(axis=1)
    assert visible_tags(target, folding, T_cam_box, SMALL).tolist() == np.flatnonzero(rho < limit).tolist()
    image = render(target, folding, T_cam_box, SMALL)
    assert image[0, 0] == 0, "no ray reaches the picture's corner"
    assert image[61, 79] > 0


def test_camera_that_looks_away_sees_no_box() -> None:
    target, T_cam_box = make_target(), look_at((0.4, 0.1, 0.15), at=(2, 0.5, 0.3))
    dim = SensorModel(paper=0.1, ink=0.0)
    assert (render(target, SMALL_CAMERA, T_cam_box, SMALL) == render(target, SMALL_CAMERA, T_cam_box, SMALL, dim)).all()
    assert len(visible_tags(target, SMALL_CAMERA, T_cam_box, SMALL)) == 0


def test_camera_below_the_floor_sees_the_bottom() -> None:
    T_cam_box = look_at((0.2, 0.1, -0.5), at=(0, 0, 0))
    image = render(make_target(), SMALL_CAMERA, T_cam_box, SMALL, EXACT)
    assert image[61, 79] == round(255 * PAPER * SHADE[4])


def test_faces_without_tags_are_plain() -> None:
    target = make_target()
    bare = replace(
        target, tag_ids=target.tag_ids[35:], tag_corners=target.tag_corners[35:], tag_faces=target.tag_faces[35:]
    )
    image = render(bare, SMALL_CAMERA, look_at((0.2, 0, 0.1)), SMALL, EXACT)
    assert (image[50:70, 70:90] == 200).all()


def test_camera_a_hairs_breadth_away_sees_one_module() -> None:
    target = make_target()
    module = tag_modules(target.box.dictionary, 17)[3, 4]
    image = render(target, SMALL_CAMERA, look_at((0.1252, 0.0018, 0.1018), at=(0, 0.0018, 0.1018)), SMALL, EXACT)
    assert (image == (200 if module else 10)).all()


def test_errors_name_what_is_wrong() -> None:
    target, T_cam_box = make_target(), POSES["front"]
    with pytest.raises(TargetError, match="inside the box"):
        render(target, CAMERA, look_at((0.01, 0, 0.1), at=(1, 0, 0.1)), SIZE)
    with pytest.raises(TargetError, match="not a rigid pose"):
        render(target, CAMERA, 2 * T_cam_box, SIZE)
    with pytest.raises(TargetError, match="not a rigid pose"):
        render(target, CAMERA, np.diag([-1.0, 1, 1, 1]) @ T_cam_box, SIZE)
    with pytest.raises(TargetError, match="not a rigid pose"):
        visible_tags(target, CAMERA, np.full((4, 4), np.nan), SIZE)
    with pytest.raises(TargetError, match="image size 0 x 480"):
        render(target, CAMERA, T_cam_box, (0, 480))
    with pytest.raises(TargetError, match="pass rng"):
        render(target, CAMERA, T_cam_box, SIZE, SensorModel(noise=1))
    with pytest.raises(TargetError, match="quality is 0"):
        encode_jpeg(np.zeros((4, 4), dtype=np.uint8), 0)


def test_jpeg_comes_back_as_it_went() -> None:
    image = render(make_target(), SMALL_CAMERA, POSES["front"], SMALL)
    coarse, fine = encode_jpeg(image, 20), encode_jpeg(image, 97)
    assert len(coarse) < len(fine)
    back = cv2.imdecode(np.frombuffer(fine, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    assert back is not None
    assert np.abs(back.astype(int) - image).mean() < 1.5
