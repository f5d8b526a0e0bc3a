"""What the report computes: residuals, gaps of legs, print scale, projection uncertainty, angles' sigmas."""

import re
from collections.abc import Callable
from dataclasses import fields, replace

import faulty
import numpy as np
import pytest

from boxcal.calib.assessment.gauges import slip_on_top
from boxcal.calib.assessment.print_scale import find_print_scale
from boxcal.calib.geometry.euler import yaw_pitch_roll, yaw_pitch_roll_sigma
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse
from boxcal.calib.likelihood.estimate import FlaggedCorner
from boxcal.calib.report.drawing import projection_data, residual_data, scene_data
from boxcal.calib.report.parameters import Row, parameter_groups
from boxcal.calib.report.tables import UNITS, face_row, rms, setting
from boxcal.calib.results.calibration import Calibration, StopResult
from boxcal.calib.results.diagnostics import Covariance
from boxcal.calib.results.stop_residuals import stops_seen
from boxcal.calib.results.trajectory import driven_legs, floor_pose
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.drive import exact_correspondences, exact_options, simulate_drive
from boxcal.calib.uncertainty.projection import projection_sigma
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel, project, unproject
from boxcal.target.measure.measured_size import Measured

Calibrations = Callable[[str], Calibration]
Drives = Callable[[str], Correspondences]


@pytest.fixture(scope="module")
def exact(calibrations: Calibrations) -> tuple[Calibration, Correspondences]:
    """A drive without any noise, and a calibration that is the truth."""
    rng = np.random.default_rng(11)
    drive = simulate_drive(faulty.ROBOT, faulty.TARGET, exact_options(6), rng)
    seen = exact_correspondences(faulty.ROBOT, faulty.TARGET, drive)
    r = faulty.ROBOT
    stops = tuple(
        StopResult(
            t_start_ns=s.t_start_ns,
            t_end_ns=s.t_end_ns,
            landmarks=len(s.landmark_ids),
            reprojection_rms_px=0.0,
            T_box_cam=T,
        )
        for s, T in zip(seen.stops, drive.T_box_cam, strict=True)
    )
    base = calibrations("good_drive")
    wheels = replace(base.wheels, rR=r.rR, rL=r.rL, b=r.b)
    true = replace(base, camera=r.camera, wheels=wheels, T_body_cam=r.T_body_cam, stops=stops)
    assert true.detail is not None
    return replace(true, detail=replace(true.detail, extra={})), seen


def test_true_calibration_leaves_no_residual_and_no_gap(exact: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = exact
    seen = stops_seen(calibration, [drive], faulty.TARGET)
    assert [s.number for s in seen] == list(range(6))
    assert max(np.abs(s.error_px).max() for s in seen) < 1e-9
    legs = driven_legs(calibration, [drive], seen)
    assert len(legs) == 5
    assert max(np.abs(leg.gap).max() for leg in legs) < 1e-9
    assert all(leg.rolled > 0.05 for leg in legs)


def test_residual_is_seen_less_expected_and_gap_is_wheels_less_images(
    exact: tuple[Calibration, Correspondences],
) -> None:
    calibration, drive = exact
    moved = replace(drive.stops[2], uv_px=drive.stops[2].uv_px + np.array([0.5, -0.25]))
    shifted = replace(drive, stops=(*drive.stops[:2], moved, *drive.stops[3:]))
    seen = stops_seen(calibration, [shifted], faulty.TARGET)
    assert np.allclose(seen[2].error_px, (0.5, -0.25), atol=1e-9)
    far = calibration.stops[1].T_box_cam.copy()
    heading = floor_pose(far, calibration.T_body_cam)[2]
    far[:2, 3] -= 0.01 * np.array([np.cos(heading), np.sin(heading)])  # images put the robot 1 cm further back
    stops = (calibration.stops[0], replace(calibration.stops[1], T_box_cam=far), *calibration.stops[2:])
    legs = driven_legs(replace(calibration, stops=stops), [drive], stops_seen(calibration, [drive], faulty.TARGET))
    assert np.allclose(legs[0].gap, 0, atol=1e-9)  # the stops seen still carry the true poses
    back = replace(calibration, stops=stops)
    legs = driven_legs(back, [drive], stops_seen(back, [drive], faulty.TARGET))
    assert np.allclose(legs[0].gap, (0.01, 0, 0), atol=1e-9)


def test_face_and_stop_of_a_residual_are_its_own(exact: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = exact
    seen = stops_seen(calibration, [drive], faulty.TARGET)
    for s in seen:
        normals = np.array([faulty.TARGET.T_box_face(int(f))[:3, 2] for f in s.face])
        towards = s.result.T_box_cam[:3, 3] - s.p_box
        assert np.all(np.sum(normals * towards, axis=1) > 0)
    rows = [face_row(f, seen) for f in range(4)]
    assert sum(r.corners for r in rows if r) == sum(len(s.face) for s in seen)


def test_wrong_corners_are_marked_and_left_out_of_the_mean(exact: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = exact
    stop = drive.stops[1]
    uv_px = stop.uv_px.copy()
    uv_px[3] += 40.0
    drive = replace(drive, stops=(drive.stops[0], replace(stop, uv_px=uv_px), *drive.stops[2:]))
    assert calibration.detail is not None
    flagged = FlaggedCorner(drive=0, stop=1, landmark_id=int(stop.landmark_ids[3]), error_px=(40.0, 40.0))
    marked = replace(calibration, detail=replace(calibration.detail, flagged_corners=(flagged,)))
    seen = stops_seen(marked, [drive], faulty.TARGET)
    assert (~seen[1].used).nonzero()[0].tolist() == [3]
    assert rms(seen[1].error_px[seen[1].used]) < 1e-9
    assert residual_data(marked, seen)["stops"][1]["wrong"] == [3]


def test_shape_of_the_box_that_was_estimated_is_allowed_for(calibrations: Calibrations) -> None:
    rng = np.random.default_rng(3)
    box = faulty.TARGET.box
    size = Measured(sx=1.004, sy=1.0, width=box.width, depth=box.depth, height=box.height, cov=np.eye(5) * 1e-12)
    printed = make_target(box, size)
    drive = simulate_drive(faulty.ROBOT, faulty.TARGET, exact_options(4), rng)
    seen = exact_correspondences(faulty.ROBOT, printed, drive)
    nominal = replace(seen, stops=tuple(replace(s, p_box=faulty.TARGET.p_box(s.landmark_ids)) for s in seen.stops))
    base = calibrations("good_drive")
    stops = tuple(
        replace(base.stops[0], t_start_ns=s.t_start_ns, T_box_cam=T)
        for s, T in zip(nominal.stops, drive.T_box_cam, strict=True)
    )
    assert base.detail is not None
    extra = replace(base.detail, extra={"scale_x": 0.004, "scale_y": 0.0})
    known = replace(base, camera=faulty.ROBOT.camera, stops=stops, detail=extra)
    assert max(np.abs(s.error_px).max() for s in stops_seen(known, [nominal], faulty.TARGET)) < 1e-9
    unknown = replace(known, detail=replace(extra, extra={}))
    assert max(np.abs(s.error_px).max() for s in stops_seen(unknown, [nominal], faulty.TARGET)) > 0.2


def test_print_scale_is_found_within_its_sigma(calibrations: Calibrations, drives: Drives) -> None:
    c, drive = calibrations("wrong_print"), drives("wrong_print")
    found = find_print_scale(c, stops_seen(c, [drive], faulty.TARGET), faulty.TARGET)
    assert found is not None
    assert found.x == pytest.approx(0.01, abs=4e-4)
    assert abs(found.y) < 4 * found.sigma_y
    c, drive = calibrations("good_drive"), drives("good_drive")
    found = find_print_scale(c, stops_seen(c, [drive], faulty.TARGET), faulty.TARGET)
    assert found is not None
    assert abs(found.x) < 4 * found.sigma_x < 0.001
    assert abs(found.y) < 4 * found.sigma_y


def test_print_scale_sigma_is_honest(calibrations: Calibrations, drives: Drives) -> None:
    """Its claims hold over new noise: the calibration stays, so poses and camera adapt within the one step."""
    c, drive = calibrations("good_drive"), drives("good_drive")
    rng, ratios = np.random.default_rng(5), []
    for _ in range(60):
        stops = [replace(s, uv_px=s.uv_px + faulty.SIGMA_PX * rng.standard_normal(s.uv_px.shape)) for s in drive.stops]
        noisy = replace(drive, stops=tuple(stops))
        clean = find_print_scale(c, stops_seen(c, [drive], faulty.TARGET), faulty.TARGET)
        found = find_print_scale(c, stops_seen(c, [noisy], faulty.TARGET), faulty.TARGET)
        assert clean is not None
        assert found is not None
        # The new noise alone: as large as the old, so found.sigma (of both together) is its root 2.
        ratios.append(((found.x - clean.x) / found.sigma_x) * np.sqrt(2))
    assert 0.7 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.3


def test_print_scale_stays_silent_where_corners_do_not_tell(calibrations: Calibrations, drives: Drives) -> None:
    c, drive = calibrations("blurred"), drives("blurred")
    assert find_print_scale(c, stops_seen(c, [drive], faulty.TARGET), faulty.TARGET) is None
    assert find_print_scale(c, (), faulty.TARGET) is None


def test_pixels_that_no_ray_reaches_have_no_sigma() -> None:
    camera = CameraModel(fu=300.0, fv=300.0, cu=320.0, cv=240.0, kr=-0.9)
    uv_px = np.array([[320.0, 240.0], [639.0, 479.0]])
    sigma = projection_sigma(camera, np.eye(11) * 1e-8, np.eye(4), uv_px=uv_px, distance=1.0)
    assert np.isfinite(sigma[0])
    assert np.isnan(sigma[1])


def test_projection_sigma_agrees_with_drawn_calibrations(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    rng = np.random.default_rng(2)
    cov = c.projection_covariance
    uv_px = np.array([[10.0, 10.0], [320.0, 240.0], [600.0, 400.0]])
    for distance in (0.5, 5.0):
        claimed = projection_sigma(c.camera, cov, c.T_body_cam, uv_px=uv_px, distance=distance)
        p_cam = np.concatenate([unproject(c.camera, uv_px), np.ones((3, 1))], axis=1)
        p_cam *= distance / np.linalg.norm(p_cam, axis=1)[:, None]
        p_body = p_cam @ c.T_body_cam[:3, :3].T + c.T_body_cam[:3, 3]
        square = np.zeros(3)
        drawn = rng.multivariate_normal(np.zeros(11), cov, size=1500)
        for d in drawn:
            R = c.T_body_cam[:3, :3] @ exp_so3(d[5:8])
            p = (p_body - c.T_body_cam[:3, 3] - d[8:]) @ R
            drawn_camera = CameraModel.from_values(c.camera.kind, c.camera.values + d[:5])
            square += np.sum((project(drawn_camera, p) - uv_px) ** 2, axis=1)
        assert np.allclose(np.sqrt(square / len(drawn)), claimed, rtol=0.08)


def test_sigmas_of_yaw_pitch_and_roll_agree_with_drawn_rotations(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    cov, R = c.detail.covariance.matrix, c.T_body_cam[:3, :3]
    rng = np.random.default_rng(4)
    drawn = rng.multivariate_normal(np.zeros(3), cov[8:11, 8:11], size=4000)
    spread = np.std([np.subtract(yaw_pitch_roll(R @ exp_so3(d)), yaw_pitch_roll(R)) for d in drawn], axis=0)
    assert np.allclose(yaw_pitch_roll_sigma(R, cov[8:11, 8:11]), spread, rtol=0.06)


def test_rotation_that_is_not_determined_has_infinite_sigmas(calibrations: Calibrations) -> None:
    cov = np.eye(14)
    cov[10, :], cov[:, 10], cov[10, 10] = np.nan, np.nan, np.inf
    assert np.all(np.isinf(yaw_pitch_roll_sigma(np.eye(3), cov[8:11, 8:11])))
    c = calibrations("good_drive")
    assert c.detail is not None
    groups = parameter_groups(replace(c, detail=replace(c.detail, covariance=Covariance(matrix=cov))))
    texts = {row.key: row.sigma_text for g in groups for row in g.rows}
    assert texts["yaw"] == texts["roll"] == "not determined"
    assert texts["tx"] == "1000"


@pytest.mark.parametrize(
    ("value", "sigma", "texts"),
    [
        (33.19712, 0.0123, ("33.197", "0.012")),
        (-0.080719, 0.00049, ("\N{MINUS SIGN}0.08072", "0.00049")),
        (613.1, 12.0, ("613", "12")),
        (613.1234, None, ("613.12", "")),
        (1.5, 0.0, ("1.50", "0.00")),
    ],
)
def test_value_has_the_digits_that_its_sigma_leaves_meaning(
    value: float, sigma: float | None, texts: tuple[str, str]
) -> None:
    row = Row(key="k", name="n", value=value, sigma=sigma, unit="", meaning="", digits=2)
    assert (row.value_text, row.sigma_text) == texts


def test_parameters_in_the_table_are_those_of_the_calibration(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    rows = {row.key: row for g in parameter_groups(c) for row in g.rows}
    sigma = c.detail.covariance.sigma
    assert rows["rL"].value == pytest.approx(1e3 * c.wheels.rL, abs=1e-12)
    assert rows["b"].sigma == pytest.approx(1e3 * sigma["b"], rel=1e-12)
    assert rows["ty"].value == pytest.approx(1e3 * c.T_body_cam[1, 3], abs=1e-12)
    assert rows["kr"].value == c.camera.kr
    assert {*rows} == {*ORDER} - {"rx", "ry", "rz"} | {"yaw", "pitch", "roll"}


def test_slip_on_top_agrees_with_simulated_slip(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    rng, slip, b = np.random.default_rng(6), c.detail.noise.slip, c.wheels.b
    step = 0.02
    rolled = step + slip * step**0.5 * rng.standard_normal((2000, 500, 2))
    heading = np.cumsum((rolled[..., 0] - rolled[..., 1]) / b, axis=1)
    aside = np.sum(rolled.mean(axis=2) * np.sin(heading), axis=1)
    said = [float(x) for x in re.findall(r"[\d.]+", slip_on_top(c))]
    assert said[0] == pytest.approx(100 * np.std(aside), rel=0.06)
    assert said[1] == pytest.approx(np.degrees(np.std(heading[:, -1])), rel=0.06)
    assert slip_on_top(replace(c, detail=None)) == ""


def test_scene_holds_what_was_driven(exact: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = exact
    seen = stops_seen(calibration, [drive], faulty.TARGET)
    scene = scene_data(calibration, seen, driven_legs(calibration, [drive], seen), faulty.TARGET)
    assert [s["stop"] for s in scene["stops"]] == list("123456")
    for stop, s in zip(scene["stops"], seen, strict=True):
        assert np.allclose(stop["cam"], s.result.T_box_cam[:3, 3], atol=1e-4)
        view = np.array(stop["view"]).reshape(4, 3)
        p_cam = view @ inverse(s.result.T_box_cam)[:3, :3].T + inverse(s.result.T_box_cam)[:3, 3]
        assert np.all(p_cam[:, 2] > 0)
    for leg, (a, b) in zip(scene["legs"], zip(scene["stops"][:-1], scene["stops"][1:], strict=True), strict=True):
        path: Array = np.array(leg["path"]).reshape(-1, 2)
        assert np.allclose(path[0], a["body"][:2], atol=2e-4)
        assert np.allclose(path[-1], b["body"][:2], atol=2e-4)
    assert len(scene["tags"]) == 140


def test_no_projection_map_is_drawn_where_a_parameter_is_not_determined(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    matrix = c.detail.covariance.matrix.copy()
    matrix[4, :], matrix[:, 4], matrix[4, 4] = np.nan, np.nan, np.inf
    assert projection_data(replace(c, detail=replace(c.detail, covariance=Covariance(matrix=matrix)))) is None
    assert projection_data(c) is not None


def test_settings_are_shown_in_their_units() -> None:
    settings = {
        "tilt_prior": np.radians(1.0),
        "ink_prior": 1e-4,
        "scale_prior": 0.002,
        "face_prior": [np.radians(0.5), 1e-3],
        "slip": 5e-4,
        "encoder_step": None,
        "rigid_floor": True,
        "nominal": None,
        "wheel_units": {"unit": "ticks", "ticks_per_turn": 4096, "reverse_left": False},
    }
    shown = {name: setting(name, value) for name, value in settings.items()}
    assert shown == {
        "tilt_prior": "1 °",
        "ink_prior": "0.1 mm",
        "scale_prior": "0.2 %",
        "face_prior": "0.5 °, 1 mm",
        "slip": "0.5 mm over the first metre",
        "encoder_step": "from the data",
        "rigid_floor": "yes",
        "nominal": "not given",
        "wheel_units": "unit: ticks, ticks_per_turn: 4096, reverse_left: no",
    }
    known = {f.name for f in fields(Settings)}
    assert set(UNITS) <= known, "a setting was renamed"
