"""Saved correspondences whose tags have their corners in another order, or whose pixels are mirrored or turned."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.calibrate import calibrate
from boxcal.calib.diagnosis.corner_order import AS_DESCRIBED, ORDERS, corner_order, with_corners_in_order
from boxcal.calib.diagnosis.first_look import first_look
from boxcal.calib.errors import CalibError
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot, with_camera
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraKind

TARGET = make_target()
Spoil = Callable[[StopObservation], StopObservation]


def _drive(kind: CameraKind = CameraKind.RADIAL, sigma_px: float = 0.05) -> Correspondences:
    rng = np.random.default_rng(5)
    robot = with_camera(turtlebot(), kind, rng) if kind is not CameraKind.RADIAL else turtlebot()
    path = simulate_drive(robot, TARGET, DriveOptions(stops=12, slip=3e-4), rng)
    return exact_correspondences(robot, TARGET, path, sigma_px, rng)


def _with(seen: Correspondences, spoil: Spoil, at: Sequence[int]) -> Correspondences:
    return replace(seen, stops=tuple(spoil(stop) if j in at else stop for j, stop in enumerate(seen.stops)))


def _in(order: Sequence[int]) -> Spoil:
    """Return what puts the pixel of corner ``order[c]`` of each tag where corner c's should stand."""

    def spoil(stop: StopObservation) -> StopObservation:
        ids = stop.landmark_ids
        rows = np.searchsorted(ids, 4 * (ids // 4) + np.array(order)[ids % 4])
        return replace(stop, uv_px=stop.uv_px[rows], cov_px2=stop.cov_px2[rows])

    return spoil


def _x_for_y(stop: StopObservation) -> StopObservation:
    return replace(stop, uv_px=stop.uv_px[:, ::-1], cov_px2=stop.cov_px2[:, ::-1, ::-1])


def _flipped(stop: StopObservation) -> StopObservation:
    return replace(stop, uv_px=stop.uv_px * (-1, 1) + (639, 0))


def _turned(stop: StopObservation) -> StopObservation:
    return replace(stop, uv_px=np.array([639.0, 479.0]) - stop.uv_px)


@pytest.mark.parametrize("order", ORDERS[1:])
@pytest.mark.parametrize("at", [(3,), (2, 3, 9), tuple(range(12))])
def test_corners_in_another_order_are_taken_for_those_that_they_are_and_said(
    order: tuple[int, ...], at: tuple[int, ...]
) -> None:
    seen = _drive()
    mended, (finding,) = with_corners_in_order(_with(seen, _in(order), at))
    assert finding.cause == "corner-order"
    assert finding.stops == at
    for stop, right in zip(mended.stops, seen.stops, strict=True):
        np.testing.assert_array_equal(stop.landmark_ids, right.landmark_ids)
        np.testing.assert_array_equal(stop.uv_px, right.uv_px)
        np.testing.assert_array_equal(stop.cov_px2, right.cov_px2)


def test_frames_on_the_move_have_their_corners_put_in_order_too() -> None:
    seen, spoil = _drive(), _in(ORDERS[5])
    frames = [
        MovingFrame(
            t_ns=s.t_end_ns + 10**9, landmark_ids=s.landmark_ids, p_box=s.p_box, faces=s.faces, uv_px=s.uv_px,
            cov_px2=s.cov_px2,
        )
        for s in (seen.stops[2], spoil(seen.stops[4]), _flipped(seen.stops[6]))
    ]  # fmt: skip
    mended, _ = with_corners_in_order(replace(_with(seen, spoil, range(12)), moving=tuple(frames)))
    assert [frame.t_ns for frame in mended.moving] == [frame.t_ns for frame in frames[:2]]
    np.testing.assert_array_equal(mended.moving[1].uv_px, seen.stops[4].uv_px)


@pytest.mark.parametrize("spoil", [_x_for_y, _flipped])
def test_stops_with_mirrored_pixels_are_left_out_and_said_and_all_of_them_are_refused_so(spoil: Spoil) -> None:
    seen = replace(_drive(), image_size=(640, 640))
    look = first_look([_with(seen, spoil, (1, 6, 10))], TARGET)
    (finding,) = look.findings
    assert finding.cause == "stops-mirrored"
    assert "Stops 2, 7, 11 (of 12) show the box mirrored, as if x and y" in finding.text[:1].upper() + finding.text[1:]
    assert [j for j, stop in enumerate(look.drives[0].stops) if not len(stop.landmark_ids)] == [1, 6, 10]
    with pytest.raises(CalibError, match=r"stops 1, 2, .*, 12 \(of 12\) show the box mirrored.*0 stops are left"):
        calibrate(_with(seen, spoil, range(12)))


@pytest.mark.parametrize("at", [(4,), (1, 6, 10)])
def test_pictures_that_were_turned_are_left_out_and_the_result_is_usable_at_most(at: tuple[int, ...]) -> None:
    found = calibrate(_with(_drive(), _turned, at))
    assert found.verdict is not None
    assert str(found.verdict.level) == "usable"
    (finding,) = (f for f in found.findings if f.cause == "pictures-turned")
    assert finding.stops == at
    assert abs(found.wheels.b - turtlebot().b) < 1e-3
    assert np.linalg.norm(found.T_body_cam[:3, 3] - turtlebot().T_body_cam[:3, 3]) < 2e-3


def test_as_many_turned_pictures_as_others_are_said_where_nothing_fits() -> None:
    with pytest.raises(
        CalibError, match=r"in the pictures of stops .* \(of 12\) by up to 1\d\d deg otherwise .* turned"
    ):
        calibrate(_with(_drive(), _turned, range(6, 12)))


@pytest.mark.parametrize("kind", list(CameraKind))
@pytest.mark.parametrize("sigma_px", [0.05, 1.0])
def test_no_lens_sheet_or_error_of_corners_makes_tags_of_another_order(kind: CameraKind, sigma_px: float) -> None:
    seen = _drive(kind, sigma_px)
    assert with_corners_in_order(seen) == (seen, [])
    upside_down = _with(
        seen, lambda s: replace(s, p_box=s.p_box * np.array([1, -1, -1]) + np.array([0, 0, 0.2])), range(12)
    )
    for stop in (*seen.stops, *upside_down.stops):
        told = corner_order(stop.landmark_ids, stop.faces, stop.p_box, stop.uv_px)
        assert told.order == AS_DESCRIBED
        assert not told.mirrored


def test_a_stop_in_disorder_or_of_few_tags_has_no_other_order() -> None:
    seen = _drive()
    rng = np.random.default_rng(2)
    shuffled = _with(seen, lambda s: replace(s, uv_px=rng.permutation(s.uv_px)), (5,))
    assert not with_corners_in_order(shuffled)[1]
    few = _with(
        seen,
        lambda s: replace(s, **{n: getattr(s, n)[:12] for n in ("landmark_ids", "faces", "p_box", "uv_px", "cov_px2")}),
        (5,),
    )
    assert not with_corners_in_order(_with(few, _in(ORDERS[3]), (5,)))[1]
