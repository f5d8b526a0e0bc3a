"""Paper that is not flat: corners predicted from what displaces blocks of the tags."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from aligned_views import CAMERA, LENS, PATTERNS, PLAIN, TARGET, bled, pose, truth, view, width_px
from scipy.ndimage import map_coordinates

from boxcal.detect.alignment.deformation.deformed_tags import blocks_moved
from boxcal.detect.alignment.deformation.edge_model import CONTRASTS, LENGTHS, edge_model
from boxcal.detect.alignment.deformation.kriging import field_of_few, krige_corners
from boxcal.detect.alignment.deformation.neighbours import close_corners, nearer_to_neighbours
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_batch import Frame
from boxcal.detect.alignment.tag_curvature import small_homographies
from boxcal.detect.image.response_curve import response_table
from boxcal.target.box import Box, make_target
from boxcal.target.render.renderer import SensorModel

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def edges_of(row):
    """Return places (E, 2) on the unit square of a pattern's edges, and which axis each is crossed along."""
    cells, m = PATTERNS.cells[row], PATTERNS.modules
    places, axes = [], []
    for line in range(m + 1):
        for along in range(m):
            if cells[along + 1, line] != cells[along + 1, line + 1]:
                places.append((line / m, (along + 0.5) / m))
                axes.append(0)
            if cells[line, along + 1] != cells[line + 1, along + 1]:
                places.append(((along + 0.5) / m, line / m))
                axes.append(1)
    return np.array(places), np.array(axes)


def left_by_homography(places, axes, across, at_corners):
    """Return what the homography that fits displacements (E,) best leaves of them, and of the corners' (4, 2)."""
    fields = small_homographies(places)[np.arange(len(axes)), axes]
    fitted = np.linalg.lstsq(fields, across, rcond=None)[0]
    return across - fields @ fitted, at_corners - np.einsum("cik,k->ci", small_homographies(SQUARE), fitted)


def block_means(places, axes, across):
    """Return the mean displacements (18,) of three by three blocks; no edge of these tags lies between two blocks."""
    out = np.zeros((9, 2))
    block = (np.minimum(places * 3, 2.999)).astype(int) @ np.array([1, 3])
    for k in range(9):
        for axis in (0, 1):
            some = (block == k) & (axes == axis)
            out[k, axis] = across[some].mean() if some.any() else 0.0
    return out.ravel()


@pytest.mark.parametrize("row", [0, 50, 139])
def test_contrasts_and_corners_covary_as_in_the_model_edge_by_edge(row):
    model = edge_model(PATTERNS)
    places, axes = edges_of(row)
    everywhere = np.concatenate([places, SQUARE, SQUARE])
    component = np.concatenate([axes, np.zeros(4, int), np.ones(4, int)])
    columns = []
    for k in range(len(everywhere)):
        unit = np.zeros(len(everywhere))
        unit[k] = 1.0
        at_corners = np.stack([unit[len(axes) : len(axes) + 4], unit[-4:]], axis=1)
        left, corners = left_by_homography(places, axes, unit[: len(axes)], at_corners)
        means = block_means(places, axes, left)
        columns.append(np.concatenate([model.contrasts[row].T @ means, corners.ravel()]))
    shown = np.array(columns).T
    for k, length in enumerate(LENGTHS):
        apart2 = np.sum((everywhere[:, None] - everywhere[None]) ** 2, axis=2)
        correlation = np.exp(-apart2 / (4 * length**2))
        for part, same in ((0, [(0, 0)]), (1, [(1, 1)]), (2, [(0, 1), (1, 0)])):
            some = sum(np.outer(component == a, component == b) for a, b in same)
            np.testing.assert_allclose(model.cov[k, part, row], shown @ (some * correlation) @ shown.T, atol=1e-8)


def test_contrasts_know_nothing_of_homographies():
    model = edge_model(PATTERNS)
    for row in (3, 77):
        places, axes = edges_of(row)
        for field in small_homographies(places)[np.arange(len(axes)), axes].T:
            np.testing.assert_allclose(model.contrasts[row].T @ block_means(places, axes, field), 0, atol=1e-9)


def drawn(rng, *, px, length, noise2=4e-4, side_px=30.0):
    """Return blocks' sums of tags that a field displaces, with noise, and the corners' true displacements, px."""
    model, rows = edge_model(PATTERNS), np.arange(0, 140, 4)
    k = LENGTHS.index(length)
    blocks, true = np.zeros((len(rows), 9, 5)), np.zeros((len(rows), 4, 2))
    for n, row in enumerate(rows):
        cov = (px / side_px) ** 2 * (model.cov[k, 0, row] + model.cov[k, 1, row])
        both = np.linalg.cholesky(cov + 1e-12 * np.eye(len(cov))) @ rng.standard_normal(len(cov))
        seen = (model.contrasts[row] @ both[:CONTRASTS]).reshape(9, 2) * side_px
        true[n] = both[CONTRASTS:].reshape(4, 2) * side_px
        for b in range(9):
            A = rng.uniform(0.5, 2.0) * np.array([[1.0, 0.2], [0.2, 1.0]])
            y = -A @ seen[b] + np.sqrt(noise2) * np.linalg.cholesky(A) @ rng.standard_normal(2)
            blocks[n, b] = A[0, 0], A[0, 1], A[1, 1], *y
    corners = 100.0 + side_px * np.broadcast_to(SQUARE, (len(rows), 4, 2))
    return rows, corners, blocks, true


@pytest.mark.parametrize("length", LENGTHS[:3])
def test_corners_are_predicted_with_errors_as_large_as_said(length):
    rng, errors, normalised, plain, factors = np.random.default_rng(7), [], [], [], []
    for _ in range(6):
        rows, corners, blocks, true = drawn(rng, px=0.3, length=length)
        found = krige_corners(PATTERNS, rows, rows // 35, corners, blocks, np.full(len(rows), 4e-4), rows >= 0)
        error = found.displacement_px - true
        factors.append(found.noise_factor)
        errors.append(error)
        plain.append(true)
        normalised.append(np.linalg.solve(np.linalg.cholesky(found.cov_px2), error[..., None]))
    assert np.std(errors) < 0.75 * np.std(plain)
    assert 0.3 < np.median(factors) < 1.6
    assert np.std(normalised) == pytest.approx(1.0, abs=0.15)


def test_a_flat_sheet_beside_a_wrinkled_one_stays_flat_and_the_other_s_sigmas_hold():
    rng, normalised = np.random.default_rng(11), []
    for _ in range(6):
        rows, corners, blocks, true = drawn(rng, px=0.3, length=0.4)
        wrinkled = rows < 70
        blocks[~wrinkled] = drawn(rng, px=1e-6, length=0.4)[2][~wrinkled]
        found = krige_corners(PATTERNS, rows, rows // 35, corners, blocks, np.full(len(rows), 4e-4), rows >= 0)
        assert np.sqrt(np.mean(found.displacement_px[~wrinkled] ** 2)) < 0.015
        assert np.sqrt(found.cov_px2[~wrinkled].max()) < 0.02
        error = (found.displacement_px - true)[wrinkled]
        normalised.append(np.linalg.solve(np.linalg.cholesky(found.cov_px2[wrinkled]), error[..., None]))
    assert np.std(normalised) == pytest.approx(1.0, abs=0.2)


def test_noise_is_taken_for_no_deformation_however_large():
    rng = np.random.default_rng(8)
    for noise2 in (4e-4, 25e-3):
        for _ in range(10):
            rows, corners, blocks, _ = drawn(rng, px=1e-6, length=0.4, noise2=noise2)
            assert (
                krige_corners(PATTERNS, rows, rows // 35, corners, blocks, np.full(len(rows), 4e-4), rows >= 0) is None
            )


@pytest.mark.parametrize("left_out", [[], [0, 7, 20]])
def test_neighbours_are_nearer_where_their_close_corners_go_the_same_way(left_out):
    rng, rows = np.random.default_rng(4), np.arange(35, 105)
    close = close_corners(TARGET)
    corners = TARGET.tag_corners.reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(corners[close[:, 0]] - corners[close[:, 1]], axis=1), 0.007, atol=1e-9)
    assert len(close) == 4 * (2 * 6 * 5 + 2 * 7 * 4)  # two pairs a gap between tags in a row or a column
    waves = np.sin(corners @ rng.normal(size=(3, 2)) * 40.0).reshape(-1, 4, 2)[rows]
    waves[left_out] = np.nan
    error = rng.normal(size=waves.shape)
    assert nearer_to_neighbours(TARGET, rows, waves + error, waves)
    assert not nearer_to_neighbours(TARGET, rows, waves, waves + error)


def test_tags_without_neighbours_say_nothing_of_the_paper():
    rows = np.array([0, 2, 40])
    assert not nearer_to_neighbours(TARGET, rows, np.ones((3, 4, 2)), np.zeros((3, 4, 2)))


def test_tags_that_no_field_explains_and_those_without_blocks_get_the_field_s_variance():
    rows, corners, blocks, _ = drawn(np.random.default_rng(9), px=0.3, length=0.4)
    blocks[0, :4, 3:] *= 40.0
    blocks[1] = np.nan
    even = np.ones(len(rows), dtype=np.bool_)
    even[0] = False
    found = krige_corners(PATTERNS, rows, rows // 35, corners, blocks, np.full(len(rows), 4e-4), even)
    np.testing.assert_array_equal(found.displacement_px[:2], 0.0)
    size = np.trace(found.cov_px2, axis1=2, axis2=3).mean(axis=1)
    assert size[:2].min() > 1.5 * size[2:].max()


def wrinkled(image, px, tags_px):
    """Return a picture displaced by smooth waves of so many pixels (rms), and what takes places along."""
    rng = np.random.default_rng(3)
    waves = cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), 0.5 * tags_px)
    waves *= px / waves.std()
    y, x = np.mgrid[: image.shape[0], : image.shape[1]].astype(float)
    bent = map_coordinates(image.astype(float), [y + 0.6 * waves, x + 0.8 * waves], order=5, mode="nearest")

    def moved(uv):
        out = uv
        for _ in range(4):
            wave = map_coordinates(waves, [out[..., 1], out[..., 0]], order=3)
            out = uv - wave[..., None] * (0.8, 0.6)
        return out

    noisy = bent + 2 * rng.standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), moved


@pytest.mark.parametrize("px", [0.1, 0.3])
def test_corners_on_wrinkled_paper_err_half_as_much_and_sigmas_hold(monkeypatch, px):
    T = pose(20.0, distance=0.6)
    image, moved = wrinkled(view(T, SensorModel(psf_px=0.6)), px, tags_px=30.0)

    def errors():
        tags = detect_tags(image, TARGET)
        wide = width_px(truth(T)[0][tags.ids]) >= 20.0
        apart = (tags.corners_px - moved(truth(T)[0][tags.ids]))[wide]
        return apart, np.linalg.solve(np.linalg.cholesky(tags.cov_px2[wide]), apart[..., None]).std()

    known, sigma = errors()
    monkeypatch.setattr("boxcal.detect.alignment.detector.deformation", lambda *_: None)
    plain, _ = errors()
    assert np.std(known) < 0.6 * np.std(plain)
    assert 0.8 < sigma < 1.25


def _shadowed():
    image = view(pose(20.0, distance=0.6)).astype(float)
    image[:, 320:] *= 0.4
    return np.rint(image).astype(np.uint8)


def _turned():
    turn = cv2.getRotationMatrix2D((320, 240), 2.0, 1.0)
    return cv2.warpAffine(view(pose(45.0, distance=0.7)), turn, (640, 480), flags=cv2.INTER_LINEAR)


@pytest.mark.parametrize(
    "picture",
    [
        lambda: view(pose(20.0, distance=0.6), PLAIN),
        lambda: view(pose(20.0, distance=0.6), SensorModel(noise=2.0, psf_px=0.0)),
        lambda: bled(0.3, CAMERA, pose(20.0, distance=0.6)),
        _shadowed,
        _turned,
    ],
    ids=["flat", "without blur", "ink that spread", "shadow", "interpolated linearly"],
)
def test_flat_paper_is_not_taken_for_deformed(monkeypatch, picture):
    image = picture()
    before = detect_tags(image, TARGET)
    monkeypatch.setattr("boxcal.detect.alignment.detector.deformation", lambda *_: None)
    after = detect_tags(image, TARGET)
    np.testing.assert_array_equal(before.corners_px, after.corners_px)
    np.testing.assert_array_equal(before.cov_px2, after.cov_px2)


def test_blocks_that_nobody_asked_for_have_not_moved():
    grey = view(pose(20.0, distance=0.6)) / np.float32(255)
    uv, rows = truth(pose(20.0, distance=0.6))
    frame = Frame(grey=grey, response=response_table("linear"), lens=LENS)
    tags = align(frame, PATTERNS, rows, uv[rows] + 0.1)
    assert np.isnan(tags.block_sums).all()
    assert not blocks_moved(tags, np.zeros(0, dtype=np.int64))
    sums = np.full((len(rows), 4), np.nan)
    sums[3] = (1.0, 1.0, 20.0, 18.0)
    assert blocks_moved(replace(tags, sandwich_sums=sums), np.zeros(0, dtype=np.int64))
    assert not blocks_moved(replace(tags, sandwich_sums=sums), rows[3:4])


def test_blocks_that_move_each_by_itself_are_not_looked_at_again(monkeypatch):
    """Pictures without blur displace blocks, but neighbours independently: five tags are enough to say so."""
    image = view(pose(20.0, distance=0.6), SensorModel(noise=2.0, psf_px=0.0))
    moved, looked = [], []
    monkeypatch.setattr(
        "boxcal.detect.alignment.deformation.deformed_tags.blocks_moved",
        lambda *a: moved.append(blocks_moved(*a)) or moved[-1],
    )
    monkeypatch.setattr("boxcal.detect.alignment.detector.deformation", lambda *_: looked.append(1))
    detect_tags(image, TARGET)
    assert moved == [True]
    assert not looked


def test_a_bend_of_the_lens_is_not_taken_for_the_paper_s():
    T, camera = pose(60.0, distance=0.4), replace(CAMERA, kr=-0.25)
    tags = detect_tags(view(T, camera=camera), TARGET)
    uv = truth(T, camera=camera)[0][tags.ids]
    normalised = np.linalg.solve(np.linalg.cholesky(tags.cov_px2), (tags.corners_px - uv)[..., None])
    assert normalised.std() < 1.2


@pytest.mark.parametrize(
    ("azimuth_deg", "distance", "most_px"), [(20.0, 0.6, 0.15), (40.0, 0.6, 0.05), (60.0, 0.4, 0.12)]
)
def test_tags_under_a_shadow_s_edge_keep_their_own_light_where_others_are_aligned_again(azimuth_deg, distance, most_px):
    T, camera = pose(azimuth_deg, distance=distance), replace(CAMERA, kr=-0.25)
    y, x = np.mgrid[:480, :640]
    light = 0.35 + 0.65 / (1 + np.exp(-np.clip((x + 0.3 * y - 380) / 0.7, -50, 50)))
    tags = detect_tags(np.rint(light * view(T, camera=camera)).astype(np.uint8), TARGET)
    apart = tags.corners_px - truth(T, camera=camera)[0][tags.ids]
    assert np.sqrt(np.sum(apart**2, axis=2).mean()) < most_px


def test_sigmas_of_a_tag_that_cannot_tell_lens_and_paper_have_both():
    target = make_target(Box(columns=1, rows=1, tag_size=0.12, pitch=0.15))
    normalised = []
    for azimuth_deg in (0.0, 8.0, 16.0, 80.0, 90.0, 100.0, 170.0, 184.0):
        for roll_deg in (-8.0, 8.0):
            T = pose(azimuth_deg, distance=0.6, roll_deg=roll_deg)
            tags = detect_tags(view(T, target=target), target)
            assert len(tags.ids)
            error = tags.corners_px - truth(T, target=target)[0][[target.row_of(int(i)) for i in tags.ids]]
            normalised.append(np.linalg.solve(np.linalg.cholesky(tags.cov_px2), error[..., None]).ravel())
    assert np.std(np.concatenate(normalised)) < 2.0


def test_few_tags_get_no_field_from_noise_and_the_field_that_displaces_them():
    for px in (1e-6, 0.3):
        rows, corners, blocks, true = drawn(np.random.default_rng(12), px=px, length=0.7)
        cov = field_of_few(PATTERNS, rows, corners, blocks, np.full(len(rows), 4e-4))
        said = np.sqrt(np.trace(cov, axis1=2, axis2=3).mean() / 2)
        assert said == pytest.approx(np.sqrt(np.mean(true**2)), rel=0.4, abs=0.01)
