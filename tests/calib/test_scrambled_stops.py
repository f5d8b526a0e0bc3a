"""Stops whose pixels are assigned to other landmarks, as in spoilt saved correspondences."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.calibrate import calibrate
from boxcal.calib.diagnosis.first_look import first_look
from boxcal.calib.diagnosis.scrambled_stops import scrambled_stops
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot, with_camera
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind

TARGET = make_target()


def _seen() -> Correspondences:
    rng = np.random.default_rng(5)
    path = simulate_drive(turtlebot(), TARGET, DriveOptions(stops=12, slip=3e-4), rng)
    return exact_correspondences(turtlebot(), TARGET, path, 0.05, rng)


def _shuffled(stop: StopObservation, seed: int = 3) -> StopObservation:
    return replace(stop, uv_px=np.random.default_rng(seed).permutation(stop.uv_px))


def test_a_stop_with_landmarks_in_another_order_is_left_out_and_said() -> None:
    seen = _seen()
    stops = tuple(_shuffled(stop) if j in {3, 8} else stop for j, stop in enumerate(seen.stops))
    look = first_look([replace(seen, stops=stops)], TARGET)
    assert [f.cause for f in look.findings] == ["stops-scrambled"]
    assert "stops 4, 9 (of 12) do not lie as those of flat sheets do" in look.findings[0].text
    found = estimate(look.drives, look.steps)
    assert found.drives[0].stops == (0, 1, 2, 4, 5, 6, 7, 9, 10, 11)
    assert np.linalg.norm(found.T_body_cam[:3, 3] - turtlebot().T_body_cam[:3, 3]) < 1e-3
    assert abs(found.b - turtlebot().b) < 4 * found.sigma["b"]


def test_too_few_stops_beside_those_in_another_order_are_refused_with_their_numbers() -> None:
    seen = _seen()
    stops = tuple(_shuffled(stop) if j > 1 else stop for j, stop in enumerate(seen.stops))
    with pytest.raises(CalibError, match=r"stops 3, 4, .*, 12 \(of 12\) do not lie .*; 2 stops are left.*at least 3"):
        calibrate(replace(seen, stops=stops))


@pytest.mark.parametrize("kind", list(CameraKind))
def test_no_lens_sheets_elsewhere_or_errors_of_corners_make_a_stop_one_in_another_order(kind: CameraKind) -> None:
    rng = np.random.default_rng(5)
    robot = with_camera(turtlebot(), kind, rng)
    path = simulate_drive(robot, TARGET, DriveOptions(stops=12, slip=3e-4), rng)
    seen = exact_correspondences(robot, TARGET, path, 1.0, rng)
    assert scrambled_stops(seen.stops) == ()
    upside_down = [replace(s, p_box=s.p_box * np.array([1, -1, -1]) + np.array([0, 0, 0.2])) for s in seen.stops]
    assert scrambled_stops(upside_down) == ()
    assert scrambled_stops([_shuffled(stop, j) for j, stop in enumerate(seen.stops)]) == tuple(range(12))
