"""Unknowns of the box and of the lens: found where they exist, harmless where they do not."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, rigid
from boxcal.calib.likelihood import CameraKind, Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate, fit
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.calib.uncertainty.cramer_rao import Truth, errors
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import Target, make_target
from boxcal.target.camera.camera_model import project_with_jacobians
from boxcal.target.measure.measured_size import Measured

STEP = radians(0.1302)
TARGET = make_target()
ROBOT = turtlebot()


@pytest.fixture(scope="module")
def drive() -> Drive:
    options = DriveOptions(stops=14, slip=3e-4, encoder_step=STEP, steps_per_sample=2)
    return simulate_drive(ROBOT, TARGET, options, np.random.default_rng(31))


def seen_as(drive: Drive, corners: Array) -> Correspondences:
    """What the robot sees of a box whose corners (T, 4, 3) differ from those that it is told."""
    real = replace(TARGET, tag_corners=corners)
    data = exact_correspondences(ROBOT, real, drive, 0.1, np.random.default_rng(0))
    return replace(data, stops=tuple(replace(s, p_box=TARGET.p_box(s.landmark_ids)) for s in data.stops))


def z_of(found: Estimate, drive: Drive) -> Array:
    truth = Truth.of(ROBOT, drive.stop_poses, slip=3e-4, encoder_step=STEP)
    return errors(found, truth) / np.sqrt(np.diag(found.cov))


def extra(found: Estimate) -> dict[str, tuple[float, float]]:
    return {n: (float(found.values[found.names.index(n)]), s) for n, s in found.extra_sigma.items()}


def face_points(face: int) -> tuple[Array, Array]:
    T = TARGET.T_box_face(face)
    return T, (TARGET.tag_corners[TARGET.tag_faces == face] - T[:3, 3]) @ T[:3, :3]


def test_ink_spread_is_found_and_spoils_nothing(drive: Drive) -> None:
    corners = TARGET.tag_corners.copy()
    for face in range(4):
        T, p = face_points(face)
        p[..., :2] += 1e-4 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
        corners[TARGET.tag_faces == face] = p @ T[:3, :3].T + T[:3, 3]
    data = seen_as(drive, corners)
    found = estimate([data], None, EstimateOptions(target=TARGET, ink_sigma=3e-4))
    value, sigma = extra(found)["ink"]
    assert abs(value - 1e-4) < 4 * sigma < 2e-5
    assert np.abs(z_of(found, drive)).max() < 3.7
    assert estimate([data]).noise.pixel_factor > 1.1 * found.noise.pixel_factor


def test_print_scale_is_found_within_its_prior(drive: Drive) -> None:
    truth = Measured(sx=1.004, sy=0.997, width=0.25, depth=0.25, height=0.2, cov=np.zeros((5, 5)))
    data = seen_as(drive, make_target(measured=truth).tag_corners)
    found = estimate([data], None, EstimateOptions(target=TARGET, scale_sigma=5e-3))
    for name, value in (("scale_x", 0.004), ("scale_y", -0.003)):
        assert abs(extra(found)[name][0] - value) < 4 * extra(found)[name][1]
    assert np.abs(z_of(found, drive)).max() < 3.7


def test_measured_sizes_bound_the_size_of_everything(drive: Drive) -> None:
    cov = np.diag([1e-3, 1e-3, 2.5e-4, 2.5e-4, 2.5e-4]) ** 2
    measured = make_target(measured=Measured(sx=1.0, sy=1.0, width=0.25, depth=0.25, height=0.2, cov=cov))
    data = exact_correspondences(ROBOT, TARGET, drive, 0.1, np.random.default_rng(0))
    plain = estimate([data])
    faces_known = EstimateOptions(target=measured, face_sigma=(1e-3, 2.5e-4))
    with_sizes = estimate([data], None, faces_known)
    assert {"scale_x", "scale_y"} <= set(with_sizes.names)
    assert with_sizes.sigma["rR"] > 1.2 * plain.sigma["rR"]
    without = estimate([data], None, replace(faces_known, measured_sizes=False, scale_sigma=5e-3))
    assert with_sizes.extra_sigma["scale_x"] < without.extra_sigma["scale_x"]


def test_face_that_was_glued_askew_is_found(drive: Drive) -> None:
    corners = TARGET.tag_corners.copy()
    T, p = face_points(2)
    askew = rigid(exp_so3(np.array([2e-3, -1e-3, 3e-3])), np.array([4e-4, -3e-4, 2e-4]))
    corners[TARGET.tag_faces == 2] = (p @ askew[:3, :3].T + askew[:3, 3]) @ T[:3, :3].T + T[:3, 3]
    found = estimate([seen_as(drive, corners)], None, EstimateOptions(target=TARGET, face_sigma=(5e-3, 5e-4)))
    wanted = dict(zip(("rx", "ry", "rz", "tx", "ty", "tz"), (2e-3, -1e-3, 3e-3, 4e-4, -3e-4, 2e-4), strict=True))
    for axis, value in wanted.items():
        assert abs(extra(found)[f"face2_{axis}"][0] - value) < 4 * extra(found)[f"face2_{axis}"][1]
        assert abs(extra(found)[f"face1_{axis}"][0]) < 4 * extra(found)[f"face1_{axis}"][1]
    assert np.abs(z_of(found, drive)).max() < 3.7


def through(lens: CameraKind, values: Array, drive: Drive) -> Correspondences:
    """What a camera with a richer lens sees."""
    data = exact_correspondences(ROBOT, TARGET, drive, 0.1, np.random.default_rng(0))
    rng, stops = np.random.default_rng(1), []
    for stop, T_box_cam in zip(data.stops, drive.T_box_cam, strict=True):
        T = inverse(T_box_cam)
        uv, _, _ = project_with_jacobians(lens, values, stop.p_box @ T[:3, :3].T + T[:3, 3])
        stops.append(replace(stop, uv_px=uv + 0.1 * rng.normal(size=uv.shape)))
    return replace(data, stops=tuple(stops))


@pytest.mark.parametrize(
    ("lens", "coefficients"),
    [
        (CameraKind.RADIAL, [-0.08]),
        (CameraKind.BROWN, [-0.25, 0.09, 2e-3, -1.5e-3, 0.0]),
    ],
)
def test_camera_model_is_found_and_chosen_by_the_images(
    drive: Drive, lens: CameraKind, coefficients: list[float]
) -> None:
    k = ROBOT.camera
    values = np.array([k.fu, k.fv, k.cu, k.cv, *coefficients])
    data = through(lens, values, drive)
    solved = fit([data], None, EstimateOptions(lens=None))
    assert solved.problem.lens is solved.camera_scores[0].kind is lens
    assert solved.camera_scores[0].score == 0 < solved.camera_scores[1].score
    found = estimate([data], None, EstimateOptions(lens=None))
    sigma = np.array(
        [
            *(found.sigma[n] for n in ("fu", "fv", "cu", "cv", "kr")),
            *(found.extra_sigma[n] for n in found.camera.further),
        ]
    )
    got = np.array(
        [
            found.camera.fu,
            found.camera.fv,
            found.camera.cu,
            found.camera.cv,
            found.camera.kr,
            *found.camera.further.values(),
        ]
    )
    assert np.abs((got - values) / sigma).max() < 4
    assert np.abs(z_of(found, drive)[5:]).max() < 3.7


def test_landmarks_of_another_box_are_refused(drive: Drive) -> None:
    data = exact_correspondences(ROBOT, TARGET, drive, 0.1, np.random.default_rng(0))
    other = make_target(measured=Measured(sx=1.01, sy=1.0, width=0.25, depth=0.25, height=0.2, cov=np.eye(5) * 1e-8))
    with pytest.raises(CalibError, match="give the target"):
        estimate([data], None, EstimateOptions(target=other, ink_sigma=1e-4))
    few = Target(
        box=TARGET.box, tag_ids=TARGET.tag_ids[:5], tag_corners=TARGET.tag_corners[:5], tag_faces=TARGET.tag_faces[:5]
    )
    with pytest.raises(CalibError, match="does not carry"):
        estimate([data], None, EstimateOptions(target=few, ink_sigma=1e-4))


def test_unneeded_unknowns_change_little_on_a_designed_box(drive: Drive) -> None:
    data = exact_correspondences(ROBOT, TARGET, drive, 0.1, np.random.default_rng(0))
    options = EstimateOptions(target=TARGET, scale_sigma=1e-3, ink_sigma=1e-4, face_sigma=(1e-3, 2e-4))
    assert np.abs(z_of(estimate([data], None, options), drive)).max() < 3.7
