import cv2
import numpy as np
import pytest
from aligned_views import SIZE, TARGET, pose, truth, view

from boxcal.detect.alignment.box_pose import fit_box
from boxcal.detect.alignment.box_search import BoxDetection
from boxcal.detect.alignment.candidates import TagCandidates, find_candidates
from boxcal.detect.alignment.detector import detect_copies, detect_tags
from boxcal.detect.alignment.face_agreement import consistent_candidates
from boxcal.detect.alignment.tag_patterns import target_patterns
from boxcal.target.box import Box, make_target

PATTERNS = target_patterns(TARGET)


def _wrong(tags, uv):
    return [int(t) for t, c in zip(tags.ids, tags.corners_px, strict=True) if np.abs(c - uv[t]).max() > 0.5]


def test_covered_tags_are_rejected_and_the_others_kept():
    T = pose(8.0, distance=0.6)
    uv, seen = truth(T)
    image = view(T)
    middle = int(np.median(uv[seen][..., 0]))
    image[:, middle:] = np.random.default_rng(1).integers(90, 130, image[:, middle:].shape)
    tags = detect_tags(image, TARGET)
    clear = uv[..., 0].max(axis=1) < middle - 3
    touched = uv[..., 0].max(axis=1) > middle + 1
    assert set(seen[clear[seen]]) <= set(tags.ids)
    assert not touched[tags.ids].any()


def test_finger_glare_and_wrong_bit_are_each_rejected():
    T = pose(4.0, distance=0.5)
    uv, seen = truth(T)
    image = view(T)
    spoilt = seen[[5, 12, 20]]
    for tag, level in zip(spoilt, (30.0, 250.0, 128.0), strict=True):
        corner, across, down = uv[tag][0], uv[tag][1] - uv[tag][0], uv[tag][3] - uv[tag][0]
        quad = [corner + a * across + b * down for a, b in ((0.4, 0.3), (0.8, 0.3), (0.8, 0.7), (0.4, 0.7))]
        cv2.fillPoly(image, [np.round(quad).astype(np.int32)], level)
    tags = detect_tags(image, TARGET)
    assert not set(spoilt) & set(tags.ids)
    assert set(seen) - set(spoilt) <= set(tags.ids)


def test_mirrored_picture_shows_no_tags():
    assert len(detect_tags(np.ascontiguousarray(view(pose(20.0))[:, ::-1]), TARGET).ids) == 0


def test_noise_text_and_squares_are_no_tags():
    rng = np.random.default_rng(5)
    noise = rng.integers(0, 255, SIZE[::-1], dtype=np.uint8)
    text = np.full(SIZE[::-1], 230, np.uint8)
    for y in range(20, 480, 25):
        cv2.putText(text, "THE QUICK BROWN FOX 0123456789 #%&@", (3, y), 0, 0.8, 20, 2)
    squares = np.kron(rng.random((24, 32)) < 0.5, np.ones((20, 20))).astype(np.uint8) * 200
    for image in (noise, text, squares):
        assert len(detect_tags(image, TARGET).ids) == 0


@pytest.mark.parametrize("shape", [(8, 9600), (8, 16_384), (16_384, 9), (9, 4000)])
def test_a_thin_strip_shows_no_tags(shape):
    noise = np.random.default_rng(6).integers(0, 255, shape, dtype=np.uint8)
    assert len(detect_tags(noise, TARGET).ids) == 0
    assert len(detect_copies(noise, PATTERNS).ids) == 0


def test_tags_of_other_ids_are_no_tags_of_the_target():
    other = make_target(Box(first_id=200))
    assert len(detect_tags(view(pose(20.0), target=other), TARGET).ids) == 0


def test_poster_of_the_same_tags_does_not_move_the_box():
    T = pose(8.0, distance=0.7)
    uv, seen = truth(T)
    image = view(T)
    small = cv2.resize(image[150:330, 240:420], None, fx=0.55, fy=0.55, interpolation=cv2.INTER_AREA)
    image[:99, :99] = small[:99, :99]
    tags = detect_tags(image, TARGET)
    assert _wrong(tags, uv) == []
    assert set(seen[uv[seen].min(axis=(1, 2)) > 100]) <= set(tags.ids)


def test_two_copies_of_one_tag_alone_are_both_dropped():
    image = np.full(SIZE[::-1], 220, np.uint8)
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 3, 64)
    image[100:164, 100:164] = image[300:364, 400:464] = marker
    seeds = find_candidates(image, PATTERNS, (25,))
    assert len(seeds) == 2
    assert len(consistent_candidates(TARGET, seeds, SIZE)) == 0
    assert len(detect_tags(image, TARGET).ids) == 0


def test_tag_pasted_elsewhere_on_the_face_is_dropped():
    T = pose(2.0, distance=0.6, elevation_deg=5.0, roll_deg=0.0)
    uv, seen = truth(T)
    image = view(T)
    target_tag, source = seen[3], seen[24]
    a, b = np.floor(uv[target_tag].min(axis=0)).astype(int) - 3, np.floor(uv[source].min(axis=0)).astype(int) - 3
    span = 40
    image[a[1] : a[1] + span, a[0] : a[0] + span] = image[b[1] : b[1] + span, b[0] : b[0] + span].copy()
    tags = detect_tags(image, TARGET)
    assert _wrong(tags, uv) == []
    assert target_tag not in tags.ids


def test_seeds_that_no_box_explains_do_no_harm():
    rng = np.random.default_rng(4)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for _ in range(12):
        image = np.full(SIZE[::-1], 225, np.uint8)
        for y in range(20, 400, 90):
            for x in range(20, 560, 90):
                side = int(rng.integers(24, 70))
                tag = cv2.aruco.generateImageMarker(dictionary, int(rng.integers(140)), side)
                image[y : y + side, x : x + side] = np.rot90(tag, int(rng.integers(4)))
        tags = detect_tags(image, TARGET)
        assert len(np.unique(tags.ids)) == len(tags.ids)
        assert np.isfinite(tags.corners_px).all()


@pytest.mark.parametrize(("azimuth_deg", "height"), [(35.0, 314), (35.0, 371), (35.0, 401), (50.0, 281), (50.0, 380)])
def test_a_tag_that_the_border_cuts_is_not_said_to_be_elsewhere(azimuth_deg, height):
    image = view(pose(azimuth_deg, distance=0.5))[:height]
    tags = detect_tags(np.ascontiguousarray(image), TARGET)
    assert len(tags.ids) > 20
    assert tags.rejected_ids.size == 0


@pytest.mark.parametrize("height", [404, 408, 412, 416])
def test_a_print_in_its_neighbour_s_place_is_said_to_be_elsewhere_where_the_border_cuts_its_own(height):
    T = pose(35.0, distance=0.5)
    image, uv = view(T), truth(T)[0]
    assert height - 0.5 < uv[65][:, 1].max()
    drawn = np.kron(20 + 200 * PATTERNS.cells[65], np.ones((20, 20)))
    square = np.array([[20, 20], [180, 20], [180, 180], [20, 180]], np.float32)
    h = cv2.getPerspectiveTransform(square, uv[66].astype(np.float32))
    cv2.warpPerspective(drawn.astype(image.dtype), h, SIZE, dst=image, borderMode=cv2.BORDER_TRANSPARENT)
    tags = detect_tags(np.ascontiguousarray(image[:height]), TARGET)
    assert tags.rejected_ids.tolist() == [65]


@pytest.mark.parametrize(("along", "across", "elsewhere"), [(0.25, 0.0, False), (0.0, 0.25, False), (0.0, 2.5, True)])
def test_a_tag_seen_at_a_slant_is_elsewhere_only_if_it_is_off_in_its_own_sides(along, across, elsewhere):
    T = pose(72.0, distance=0.5)
    uv, seen = truth(T)
    narrow = [t for t in seen if np.linalg.norm(uv[t][1] - uv[t][0]) < 0.45 * np.linalg.norm(uv[t][3] - uv[t][0])]
    (tag, *_) = narrow
    right, down = uv[tag][1] - uv[tag][0], uv[tag][3] - uv[tag][0]
    assert 0.25 * np.linalg.norm(down) > 0.5 * np.linalg.norm(right)
    read = TagCandidates(rows=np.array([tag]), corners_px=uv[[tag]] + along * down + across * right, score=np.ones(1))
    box = BoxDetection(
        tags=None, fit=fit_box(TARGET, seen, uv[seen], image_size=SIZE, sigma_px=0.5),
        lost_module_px=0.0, lost_region_px=np.zeros((2, 2)), read=read,
    )  # fmt: skip
    off = box.off_the_box(TARGET, box.fit, np.zeros(0, np.int64), SIZE)
    assert off.tolist() == [tag] * elsewhere
