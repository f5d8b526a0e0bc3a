"""Corners whose pixels are assigned to other landmarks of the same stop, as in spoilt saved correspondences."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.calibrate import calibrate
from boxcal.calib.diagnosis import first_look as look_module
from boxcal.calib.diagnosis.first_look import first_look
from boxcal.calib.diagnosis.odd_corners import odd_corners, without_odd_corners
from boxcal.calib.diagnosis.scrambled_stops import ALIKE
from boxcal.calib.errors import CalibError
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot, with_camera
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind

TARGET = make_target()


def _drive(kind: CameraKind = CameraKind.RADIAL, sigma_px: float = 0.05) -> Correspondences:
    rng = np.random.default_rng(5)
    robot = with_camera(turtlebot(), kind, rng) if kind is not CameraKind.RADIAL else turtlebot()
    path = simulate_drive(robot, TARGET, DriveOptions(stops=12, slip=3e-4), rng)
    return exact_correspondences(robot, TARGET, path, sigma_px, rng)


def _ends_of_sheet_exchanged(stop: StopObservation) -> StopObservation:
    on = np.flatnonzero(stop.faces == stop.faces[0])
    uv = stop.uv_px.copy()
    uv[on[[0, -2]]] = uv[on[[-2, 0]]]
    return replace(stop, uv_px=uv)


def _first_sheet_shuffled(stop: StopObservation) -> StopObservation:
    on = np.flatnonzero(stop.faces == stop.faces[0])
    uv = stop.uv_px.copy()
    uv[on] = np.random.default_rng(3).permutation(uv[on])
    return replace(stop, uv_px=uv)


_SPOILT = (2, 3, 5, 6, 8, 9, 11)
"""Stops that see two sheets, of which the first has fewer corners."""


def _with(
    seen: Correspondences, spoil: Callable[[StopObservation], StopObservation], at: Sequence[int]
) -> Correspondences:
    return replace(seen, stops=tuple(spoil(stop) if j in at else stop for j, stop in enumerate(seen.stops)))


def test_a_pair_of_landmarks_exchanged_at_every_stop_is_left_out_and_said() -> None:
    seen = _drive()
    spoilt = _with(seen, _ends_of_sheet_exchanged, range(12))
    look = first_look([spoilt], TARGET)
    (finding,) = look.findings
    assert finding.cause == "corners-odd"
    assert finding.adopted
    for j in finding.stops:
        left, whole = look.drives[0].stops[j], seen.stops[j]
        kept = np.isin(whole.landmark_ids, left.landmark_ids)
        assert kept.sum() == len(kept) - 2
        assert np.array_equal(left.uv_px, whole.uv_px[kept])  # what was left in is right
    found = calibrate(spoilt, TARGET)
    assert abs(found.wheels.b / turtlebot().b - 1) < 4e-3
    assert np.linalg.norm(found.T_body_cam[:3, 3] - turtlebot().T_body_cam[:3, 3]) < 2e-3


def _six_tags_of_a_sheet(stop: StopObservation) -> StopObservation:
    few = np.flatnonzero(stop.faces == stop.faces[0])[-24:]
    names = ("landmark_ids", "faces", "p_box", "uv_px", "cov_px2")
    return replace(stop, **{name: getattr(stop, name)[few] for name in names})


def test_where_they_leave_no_camera_to_begin_with_they_are_looked_for_in_every_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = _with(_drive(), _six_tags_of_a_sheet, range(12))
    spoilt = _with(seen, _ends_of_sheet_exchanged, range(12))
    monkeypatch.setattr(look_module, "ALIKE", np.inf)  # none of these stops stands out
    look = first_look([spoilt], TARGET)
    assert [(f.cause, f.stops) for f in look.findings] == [("corners-odd", tuple(range(12)))]
    assert all(len(stop.faces) == 22 for stop in look.drives[0].stops)
    monkeypatch.setattr(look_module, "without_odd_corners", lambda drives, _=0.0: (list(drives), []))
    with pytest.raises(CalibError, match="no focal length fits"):
        first_look([spoilt], TARGET)


def test_a_sheet_in_disorder_at_one_stop_is_left_out_there() -> None:
    seen = _drive()
    look = first_look([_with(seen, _first_sheet_shuffled, (5,))], TARGET)
    assert [(f.cause, f.stops) for f in look.findings] == [("corners-odd", (5,))]
    assert np.unique(look.drives[0].stops[5].faces) == np.unique(seen.stops[5].faces)[-1:]
    assert all(look.drives[0].stops[j] is seen.stops[j] for j in range(12) if j != 5)


def test_a_twentieth_of_odd_corners_and_more_is_never_good() -> None:
    spoilt = _with(_drive(), _first_sheet_shuffled, _SPOILT)
    assert [(f.cause, f.adopted) for f in first_look([spoilt], TARGET).findings] == [("corners-odd", False)]
    assert calibrate(spoilt, TARGET).verdict.level.value != "good"


def test_a_drive_that_fails_without_its_odd_corners_too_says_so() -> None:
    spoilt = _with(_drive(), _first_sheet_shuffled, _SPOILT)
    still = replace(spoilt, stops=tuple(replace(s, phi_R=0.0, phi_L=0.0) for s in spoilt.stops))
    with pytest.raises(CalibError, match=r"corners \(stops .* of 12\) are far .*; without them: the moves "):
        first_look([still], TARGET)


@pytest.mark.parametrize("kind", list(CameraKind))
def test_no_lens_and_no_errors_of_corners_make_corners_odd(kind: CameraKind) -> None:
    seen = _drive(kind, 1.0)
    assert without_odd_corners([seen], ALIKE)[1] == []
    if kind is not CameraKind.FISHEYE:
        assert not any(odd_corners(stop).any() for stop in seen.stops)
