"""Large pictures are searched shrunken, without losing what the whole picture shows."""

import numpy as np
import pytest
from aligned_views import TARGET, pose, width_px

from boxcal.detect.alignment import pyramid_search as find
from boxcal.detect.alignment.box_growth import ALIGNED_SIGMA_PX, fit_aligned
from boxcal.detect.alignment.box_pose import _nearest_rotation, fit_box
from boxcal.detect.alignment.box_search import CANDIDATE_SIGMA_PX, predict_regions
from boxcal.detect.alignment.candidates import TagCandidates, find_candidates
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.tag_patterns import target_patterns
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.render.renderer import SensorModel, render, visible_tags

SIZE = (1280, 960)


def _aimed(T_cam_box, focal, off_px):
    """Return the pose turned so that the box's middle is seen so far from the picture's."""
    a = T_cam_box[:3, :3] @ (0, 0, 0.1) + T_cam_box[:3, 3]
    a, b = a / np.linalg.norm(a), np.array([off_px[0] / focal, off_px[1] / focal, 1.0])
    b /= np.linalg.norm(b)
    v = np.cross(a, b)
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turn = np.eye(4)
    turn[:3, :3] = np.eye(3) + cross + cross @ cross / (1 + a @ b)
    return turn @ T_cam_box


def _found(image, uv, rows):
    tags = detect_tags(image, TARGET)
    right = np.abs(tags.corners_px - uv[tags.ids]).max(axis=(1, 2)) < 0.5
    assert right.all()
    return len(np.intersect1d(tags.ids, rows))


def test_a_face_that_a_shrunken_picture_hides_is_found(monkeypatch):
    # from one face in the shrunken picture the fit takes the wrong one of two poses
    camera = CameraModel(fu=1912.9521, fv=1912.9521, cu=658.222715, cv=469.285216, kr=-0.1)
    T = _aimed(pose(206.5116, distance=2.841173, elevation_deg=6.553026), camera.fu, (232.301256, 45.593439))
    uv = project(camera, TARGET.tag_corners @ T[:3, :3].T + T[:3, 3])
    seen = np.array([TARGET.row_of(int(i)) for i in visible_tags(TARGET, camera, T, SIZE, 2.0)])
    image = render(TARGET, camera, T, SIZE, SensorModel(noise=2.0, psf_px=0.6), np.random.default_rng(50))
    wanted = seen[width_px(uv[seen]) >= 8]
    assert len(np.unique(TARGET.tag_faces[wanted])) == 2
    assert _found(image, uv, wanted) == len(wanted)
    monkeypatch.setattr(find, "shrinkings", lambda _: [1])
    assert _found(image, uv, wanted) == len(wanted)


def test_a_large_near_box_is_found_without_looking_at_the_whole_picture(monkeypatch):
    camera = CameraModel(fu=1400.0, fv=1400.0, cu=650.0, cv=472.0, kr=-0.1)
    T = pose(25.0, distance=0.7)
    image = render(TARGET, camera, T, SIZE, SensorModel(noise=2.0, psf_px=0.6), np.random.default_rng(1))
    sizes = []

    def counted(searched, *further, **named):
        sizes.append(searched.shape)
        return find_candidates(searched, *further, **named)

    monkeypatch.setattr(find, "find_candidates", counted)
    assert len(detect_tags(image, TARGET).ids) >= 60
    assert sizes == [(480, 640)]


def test_a_face_seen_at_a_slant_does_not_contradict_the_box_for_its_rough_corners():
    camera = CameraModel(fu=4800.0, fv=4800.0, cu=1919.5, cv=1079.5, kr=-0.1)
    T = pose(62.0, distance=0.8)
    uv = project(camera, TARGET.tag_corners @ T[:3, :3].T + T[:3, 3])
    rows = np.array([TARGET.row_of(int(i)) for i in visible_tags(TARGET, camera, T, (3840, 2160), 2.0)])
    slanted = TARGET.tag_faces[rows] == 0
    assert 10 < slanted.sum() < len(rows) - 10
    corners = uv[rows].copy()
    middle = corners[slanted].mean(axis=1, keepdims=True)
    corners[slanted] = middle + 0.86 * (corners[slanted] - middle)
    candidates = TagCandidates(rows=rows, corners_px=corners, score=np.ones(len(rows)))
    there = predict_regions(TARGET, target_patterns(TARGET), candidates, (3840, 2160), sigma_px=2.0)
    assert there.contradicting_faces == ()
    corners[slanted] += (0.0, 400.0)
    elsewhere = predict_regions(TARGET, target_patterns(TARGET), candidates, (3840, 2160), sigma_px=2.0)
    assert elsewhere.contradicting_faces == (0,)


def test_one_tag_of_a_second_face_is_kept_however_rough_its_corners_were_at_first():
    # they turn camera and box so far that the same tag, aligned, would count as off the box, and its face with it
    rng = np.random.default_rng(18)
    camera = CameraModel(fu=1200.0, fv=1200.0, cu=639.5, cv=479.5, kr=-0.05)
    azimuth, distance, elevation, roll = rng.uniform((18, 0.4, 4, -8), (24, 0.55, 20, 8))
    T = pose(azimuth, distance=distance, elevation_deg=elevation, roll_deg=roll)
    rows = np.append(np.flatnonzero(TARGET.tag_faces == 0), rng.choice(np.flatnonzero(TARGET.tag_faces == 1)))
    uv = project(camera, TARGET.tag_corners[rows] @ T[:3, :3].T + T[:3, 3])
    aligned = uv + rng.normal(0, 0.02, uv.shape)
    rough = aligned.copy()
    rough[-1] += rng.normal(0, 1.5, (4, 2))
    start = fit_box(TARGET, rows, rough, image_size=SIZE, sigma_px=CANDIDATE_SIGMA_PX)
    once = fit_box(TARGET, rows, aligned, image_size=SIZE, sigma_px=ALIGNED_SIGMA_PX, start=start)
    assert abs(once.focal_px - camera.fu) > 50
    fit, kept = fit_aligned(TARGET, target_patterns(TARGET), rows, aligned, image_size=SIZE, start=start)
    np.testing.assert_array_equal(kept, rows)
    assert abs(fit.focal_px - camera.fu) < 10


@pytest.mark.parametrize("angle_deg", [0.0, 40.0, 90.0, 140.0, 180.0])
def test_a_start_from_any_homography_is_a_rotation_between_its_columns(angle_deg):
    angle = np.deg2rad(angle_deg)
    R = _nearest_rotation(np.array([0.0, 3.0, 0.0]), 2 * np.array([0.0, np.cos(angle), np.sin(angle)]))
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    assert np.isclose(R[1, 0], R[:, 1] @ (0, np.cos(angle), np.sin(angle)))
