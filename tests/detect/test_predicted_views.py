"""Views predicted between stops: where the box is seen, the clock offset and exposure that frames tell, and trust."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import boxcal
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, rigid
from boxcal.calib.one_robot.views_by_wheels import views_by_wheels
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.detect.alignment import detector
from boxcal.detect.alignment.pyramid_search import find_box
from boxcal.detect.extract import ExtractSettings, extract
from boxcal.detect.tags.predicted_views import ClockedViews, PredictedViews
from boxcal.target.camera.camera_model import project

OPTIONS = DriveOptions(stops=6, slip=0.0, encoder_step=0.0)
LATE_S, EXPOSURE_S = 0.03, 0.01


@pytest.fixture(scope="module")
def simulated():
    """Return a robot's drive without noise, and what it sees at its stops."""
    made = boxcal.simulate(options=OPTIONS, seed=3)
    seen = exact_correspondences(made.robot, made.target, made.drive, 0.0, np.random.default_rng(0))
    return made, seen


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, simulated):
    """Return a log of that drive whose camera's stamps are late."""
    made, _ = simulated
    path = tmp_path_factory.mktemp("log") / "r.mcap"
    options = RecordOptions(moving_frames=12, exposure_s=EXPOSURE_S, late_s=LATE_S)
    write_log(path, made.robot, made.target, made.drive, options, rng=np.random.default_rng(1))
    return path


def _between(drive, share):
    ended, begun = drive.stop_t_ns[:-1, 1], drive.stop_t_ns[1:, 0]
    return (ended + share * (begun - ended)).astype(np.int64)


@pytest.mark.parametrize("share", [0.1, 0.45, 0.55, 0.9])
def test_poses_between_stops_are_predicted_exactly_without_noise(simulated, share):
    made, seen = simulated
    samples = seen.wheels.t_ns
    t_ns = samples[np.searchsorted(samples, _between(made.drive, share))]
    views = views_by_wheels(seen)
    truth = np.array([made.drive.T_box_cam_at(t_ns[[k]], k)[0] for k in range(len(t_ns))])
    np.testing.assert_allclose(views.T_cam_box_at(t_ns), inverse(truth), atol=1e-6)


def test_nothing_is_predicted_before_the_first_stop_and_behind_the_last(simulated):
    made, seen = simulated
    times = made.drive.stop_t_ns
    assert np.isnan(views_by_wheels(seen).T_cam_box_at(np.array([times[0, 0] - 1, times[-1, 1] + 1]))).all()


def test_nothing_is_predicted_where_the_closed_form_finds_no_answer(simulated):
    _, seen = simulated
    assert views_by_wheels(replace(seen, stops=seen.stops[:2])) is None


def test_tags_that_face_the_camera_are_expected_where_it_sees_them(simulated):
    made, seen = simulated
    stop = seen.stops[2]
    clocked = ClockedViews(views=views_by_wheels(seen), target=made.target, image_size=seen.image_size)
    expected = clocked.expected(int(stop.t_end_ns))
    there = np.isin(4 * expected.ids, stop.landmark_ids)
    assert 4 * there.sum() == len(stop.landmark_ids)
    np.testing.assert_allclose(expected.corners_px[there].reshape(-1, 2), stop.uv_px, atol=2e-3)


def _learned(made, views, size, late_s):
    clocked = ClockedViews(views=views, target=made.target, image_size=size)
    for k, t_ns in enumerate(_between(made.drive, 0.3).tolist()):
        T = inverse(made.drive.T_box_cam_at(np.array([t_ns]), k)[0])
        p_box = made.target.tag_corners[:3].reshape(-1, 3)
        uv = project(made.robot.camera, p_box @ T[:3, :3].T + T[:3, 3])
        if np.isfinite(uv).all():
            clocked.learn(t_ns + round(1e9 * late_s), p_box, uv, (np.zeros(2), 1.0))
    return clocked


@pytest.mark.parametrize("late_s", [-0.05, 0.03])
def test_the_clock_offset_is_told_by_where_frames_show_the_box(simulated, late_s):
    made, seen = simulated
    clocked = _learned(made, views_by_wheels(seen), seen.image_size, late_s)
    assert clocked.told_s
    assert np.abs(np.array(clocked.told_s) - late_s).max() < 5e-4


@pytest.mark.parametrize("late_s", [-0.05, 0.03])
def test_tags_may_be_where_clocks_that_differ_put_them_until_a_frame_tells(simulated, late_s):
    made, seen = simulated
    views = views_by_wheels(seen)
    clocked = ClockedViews(views=views, target=made.target, image_size=seen.image_size)
    taken = _between(made.drive, 0.1).tolist()
    slow = min(taken, key=lambda t_ns: float(np.linalg.norm(clocked._motion(t_ns))))
    expected = clocked.expected(slow + round(1e9 * late_s))
    there, _ = views.tags(made.target.tag_corners, np.array([slow]))
    rows = np.isin(made.target.tag_ids, expected.ids)
    side = np.median(np.linalg.norm(there[0, rows, 1] - there[0, rows, 0], axis=1))
    off = np.abs(expected.places_px - there[0, rows]).max(axis=(1, 2, 3))
    assert off.min() < 0.06 * side
    told = _learned(made, views, seen.image_size, late_s)
    assert len(told.expected(slow).places_px) == 0


def test_tags_of_a_box_that_stands_still_in_the_picture_are_nowhere_else(simulated):
    made, seen = simulated
    clocked = ClockedViews(views=views_by_wheels(seen), target=made.target, image_size=seen.image_size)
    at_rest = int(made.drive.stop_t_ns[2].mean())
    assert not clocked._motion(at_rest).any()
    expected = clocked.expected(at_rest)
    assert len(expected.ids)
    assert expected.places_px.shape == (0, len(expected.ids), 4, 2)


def test_offsets_are_those_of_the_nearest_frame_where_a_clock_jumps(simulated):
    made, seen = simulated
    clocked = _learned(made, views_by_wheels(seen), seen.image_size, 0.0)
    first, second = clocked.told_ns[0], clocked.told_ns[-1]
    assert second - first > 2_000_000_000
    clocked.told_s[:] = [0.01] * (len(clocked.told_s) - 1) + [0.2]
    at = np.array([first + 1000, second - 1000])
    np.testing.assert_allclose(clocked.late_s(at), [0.01, 0.2])


def test_frames_that_lie_far_off_the_prediction_tell_no_offset(simulated):
    made, seen = simulated
    views = views_by_wheels(seen)
    tilt = rigid(exp_so3(np.array([0.1, 0.0, 0.0])), np.zeros(3))
    wrong = PredictedViews(camera=views.camera, T_cam_box_at=lambda t_ns: tilt @ views.T_cam_box_at(t_ns))
    assert not _learned(made, wrong, seen.image_size, 0.03).told_s


def test_slow_frames_do_not_take_the_prediction_s_error_for_an_offset(simulated):
    made, seen = simulated
    views = views_by_wheels(seen)
    aside = rigid(exp_so3(np.array([0.0, 0.005, 0.0])), np.zeros(3))  # some 3 px, as after slip
    speeds = []
    for share in (1.0, 0.5, 0.25, 0.12, 0.06):
        for t_ns in np.concatenate([_between(made.drive, part) for part in (0.1, 0.3, 0.7, 0.9)]).tolist():

            def slowly(at, t_ns=t_ns, share=share):
                return views.T_cam_box_at(t_ns + np.rint(share * (at - t_ns)).astype(np.int64))

            wrong = PredictedViews(camera=views.camera, T_cam_box_at=lambda at, slowly=slowly: aside @ slowly(at))
            clocked = ClockedViews(views=wrong, target=made.target, image_size=seen.image_size)
            seen_now = clocked.expected(t_ns)
            inside = np.all(
                (seen_now.corners_px > 10) & (seen_now.corners_px < np.array(seen.image_size) - 10), axis=(1, 2)
            )
            if np.sum(inside) < 3:
                continue
            T = slowly(np.array([t_ns]))[0]
            p_box = made.target.tag_corners[np.isin(made.target.tag_ids, seen_now.ids[inside])].reshape(-1, 3)
            clocked.learn(t_ns, p_box, project(views.camera, p_box @ T[:3, :3].T + T[:3, 3]), (np.zeros(2), 1.0))
            speeds += [float(np.linalg.norm(clocked._motion(t_ns)))] * len(clocked.told_s)
            assert np.all(np.abs(clocked.told_s) < 0.04)
    assert speeds


def test_the_blur_of_a_frame_tells_the_exposure_and_that_the_blur_of_the_next(simulated):
    made, seen = simulated
    clocked = _learned(made, views_by_wheels(seen), seen.image_size, 0.0)
    clocked.exposures.clear()
    first, second = _between(made.drive, 0.3)[[1, 3]].tolist()
    shapes = []
    for t_ns in (first, second):
        v = clocked._motion(t_ns)
        added = (EXPOSURE_S * np.linalg.norm(v)) ** 2 / 24
        shapes.append((added / (added + 0.5)) * np.array([v[0] ** 2 - v[1] ** 2, 2 * v[0] * v[1]]) / (v @ v))
        if t_ns == first:
            clocked.learn(first, np.zeros((0, 3)), np.zeros((0, 2)), (shapes[0], added + 0.5))
    np.testing.assert_allclose(clocked.exposures[0], [EXPOSURE_S, 0.5], rtol=1e-3)
    np.testing.assert_allclose(clocked.expected(second).blur, shapes[1], atol=0.02)


def _errors(made, found):
    out = []
    for frame in found.moving:
        taken = np.array([frame.t_ns - round(1e9 * LATE_S)])
        leg = int(np.searchsorted(made.drive.stop_t_ns[:, 1], taken[0])) - 1
        T = inverse(made.drive.T_box_cam_at(taken, leg)[0])
        uv = project(made.robot.camera, frame.p_box @ T[:3, :3].T + T[:3, 3])
        out.append(np.sqrt(np.mean((frame.uv_px - uv) ** 2)))
    return np.array(out)


def test_frames_are_found_where_they_are_predicted_without_searching_their_pictures(
    simulated, recorded: Path, monkeypatch
):
    made, _ = simulated
    searched = []
    monkeypatch.setattr(detector, "find_box", lambda *a, **k: searched.append(1) or find_box(*a, **k))
    found = extract(recorded, made.target, settings=ExtractSettings(predictor=views_by_wheels))
    assert len(found.moving) >= 3
    assert len(searched) <= OPTIONS.stops + 1
    assert _errors(made, found).max() < 0.5


@pytest.mark.parametrize("wrong", ["turned", "away", "too late"])
def test_wrong_predictions_cost_frames_or_time_but_bias_nothing(simulated, recorded: Path, wrong):
    made, _ = simulated

    def predictor(drive):
        views = views_by_wheels(drive)
        if wrong != "too late":
            turn = rigid(exp_so3(np.array([0.0, 0.08 if wrong == "turned" else np.pi, 0.0])), np.zeros(3))
            return PredictedViews(camera=views.camera, T_cam_box_at=lambda t: turn @ views.T_cam_box_at(t))
        return PredictedViews(camera=views.camera, T_cam_box_at=lambda t: views.T_cam_box_at(t - 300_000_000))

    found = extract(recorded, made.target, settings=ExtractSettings(predictor=predictor))
    assert found.moving
    assert _errors(made, found).max() < 0.5
