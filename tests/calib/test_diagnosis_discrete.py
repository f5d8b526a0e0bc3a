"""Causes that are decided before the likelihood: how sheets are glued, how the box stands, what wheel readings mean."""

import re
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest

from boxcal.calib.assessment.findings import finding_reason
from boxcal.calib.calibrate import calibrate
from boxcal.calib.diagnosis.clock import clock_finding, find_offset
from boxcal.calib.diagnosis.counters import counter_finding, jumps
from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.diagnosis.first_look import FirstLook, first_look
from boxcal.calib.diagnosis.frozen import frozen_stops
from boxcal.calib.diagnosis.joint_units import judge_units
from boxcal.calib.diagnosis.last_look import last_look
from boxcal.calib.diagnosis.layout import other_layout
from boxcal.calib.diagnosis.rejected_tags import rejected_finding
from boxcal.calib.diagnosis.sheets import find_gluing
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.step1_camera import calibrate_camera
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.results.verdict import Level
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.imperfect_drive import imperfect_drive, seen_from
from boxcal.calib.simulate.imperfections import BoxFaults, Imperfections, WheelFaults
from boxcal.calib.simulate.robot import Robot, khepera, turtlebot
from boxcal.detect.correspondences import Correspondences, load_correspondences
from boxcal.detect.log.losses import Loss, LossKind
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array
from boxcal.target.box import Box, make_target

TARGET = make_target()


def drive(robot: Robot, faults: Imperfections, seed: int = 5) -> Correspondences:
    options = DriveOptions(stops=12, steps_per_sample=2)
    return imperfect_drive(robot, TARGET, options, faults, np.random.default_rng(seed)).seen


def causes(look: FirstLook) -> list[str]:
    found = estimate(look.drives, look.steps)
    return [f.cause for f in (*look.findings, *last_look(look, found))]


@pytest.mark.parametrize(
    ("base", "higher", "cause"),
    [
        ("r1/base_footprint", 0.0, None),
        ("base_footprint", 0.015, None),
        ("base_footprint", 0.03, "box-raised"),
        ("base_footprint", -0.03, "camera-height"),
        ("base_link", 0.03, "box-raised"),  # no base link lies below the floor
        ("base_link", -0.06, None),  # but it may lie as high as the wheels
        ("base_link", -0.1, "camera-height"),
        ("", 0.0, None),
    ],
)
def test_a_camera_that_is_not_as_high_as_described_is_said_and_never_good(
    base: str, higher: float, cause: str | None
) -> None:
    seen = drive(turtlebot(), Imperfections())
    T = turtlebot().T_body_cam.copy()
    T[2, 3] += higher
    told = tuple(T.ravel().tolist()) if base else ()
    look = first_look([replace(seen, source=replace(seen.source, base_frame=base, nominal_T_base_cam=told))], TARGET)
    findings = last_look(look, estimate(look.drives, look.steps))
    assert [f.cause for f in findings] == ([] if cause is None else [cause])
    for finding in findings:
        assert finding_reason(finding).level is Level.USABLE
        assert finding.size == pytest.approx({0.03: 30, -0.03: 30, -0.1: 100 - 66}[higher], abs=1.5)


@pytest.mark.parametrize(
    ("box", "said"),
    [
        (BoxFaults(order=(1, 0, 2, 3)), "sheets 0 and 1 are swapped"),
        (BoxFaults(order=(2, 1, 0, 3)), "sheets 0 and 2 are swapped"),
        (BoxFaults(order=(0, 3, 2, 1)), "in reverse order"),
        (BoxFaults(turned=(2,)), "sheet 2 is glued upside down"),
        (BoxFaults(order=(1, 0, 2, 3), turned=(3,)), "sheet 3 is glued upside down"),
    ],
)
def test_sheets_are_found_where_they_are_and_the_result_is_right(box: BoxFaults, said: str) -> None:
    robot = turtlebot()
    look = first_look([drive(robot, Imperfections(box=box))], TARGET)
    assert said in look.findings[0].text
    assert look.findings[0].adopted
    found = estimate(look.drives, look.steps)
    assert abs(found.b - robot.b) < 4 * found.sigma["b"]
    assert abs(found.camera.fu - robot.camera.fu) < 4 * found.sigma["fu"]


def one_sheet_a_stop(seen: Correspondences) -> Correspondences:
    """Return a drive that sees one sheet at each stop, the one with the most tags."""
    stops = []
    for stop in seen.stops:
        sheet = TARGET.tag_faces[[TARGET.row_of(int(i) // 4) for i in stop.landmark_ids]]
        on = sheet == np.bincount(sheet).argmax()
        ids, p, uv, cov = stop.landmark_ids[on], stop.p_box[on], stop.uv_px[on], stop.cov_px2[on]
        faces = None if stop.faces is None else stop.faces[on]
        stops.append(replace(stop, landmark_ids=ids, p_box=p, uv_px=uv, cov_px2=cov, faces=faces))
    return replace(seen, stops=tuple(stops))


@pytest.mark.parametrize(
    ("box", "said"),
    [
        (BoxFaults(order=(1, 0, 2, 3)), "sheets 0 and 1 are swapped"),
        (BoxFaults(order=(0, 3, 2, 1)), "in reverse order"),
        (BoxFaults(turned=(2,)), "sheet 2 is glued upside down"),
    ],
)
def test_sheets_that_are_never_seen_together_are_found_by_the_wheels(box: BoxFaults, said: str) -> None:
    robot = turtlebot()
    seen = one_sheet_a_stop(drive(robot, Imperfections(box=box)))
    assert find_gluing(seen.stops, seen.image_size, TARGET) is None
    look = first_look([seen], TARGET)
    assert said in look.findings[0].text
    assert "agree to" in look.findings[0].text
    found = estimate(look.drives, look.steps)
    assert abs(found.b - robot.b) < 4 * found.sigma["b"]


def test_one_sheet_a_stop_where_it_belongs_is_left_alone() -> None:
    assert first_look([one_sheet_a_stop(drive(turtlebot(), Imperfections()))], TARGET).findings == ()


def test_a_print_whose_size_no_picture_tells_is_said_to_be_unchecked() -> None:
    seen = drive(turtlebot(), Imperfections())
    told, alone = calibrate(seen).verdict, calibrate(one_sheet_a_stop(seen)).verdict
    assert told is not None
    assert alone is not None
    assert told.unchecked == ()
    assert "print" in {reason.rule for reason in told.passed}
    assert [reason.rule for reason in alone.unchecked] == ["print"]
    assert "one face of the box only" in alone.unchecked[0].text
    assert "print" not in {reason.rule for reason in alone.passed}


def test_a_frozen_picture_is_left_out_and_said() -> None:
    seen = drive(turtlebot(), Imperfections())
    first = seen.stops[4]
    repeated = tuple(
        replace(
            stop, landmark_ids=first.landmark_ids, p_box=first.p_box, uv_px=first.uv_px, cov_px2=first.cov_px2,
            faces=first.faces,
        )
        if j in {5, 6}
        else stop
        for j, stop in enumerate(seen.stops)
    )  # fmt: skip
    look = first_look([replace(seen, stops=repeated)], TARGET)
    assert [f.cause for f in look.findings] == ["pictures-frozen"]
    assert "stops 6, 7 of 12" in look.findings[0].text
    found = estimate(look.drives, look.steps)
    assert found.drives[0].stops == (0, 1, 2, 3, 4, 7, 8, 9, 10, 11)  # all keep their numbers
    assert abs(found.b - turtlebot().b) < 4 * found.sigma["b"]
    assert frozen_stops(seen.stops) == ()
    assert frozen_stops(look.drives[0].stops) == ()  # two stops that see nothing do not show one picture
    result = calibrate(replace(seen, stops=repeated))
    assert result.verdict is not None
    assert result.verdict.level is Level.GOOD


@pytest.mark.parametrize("around", [4.5, 20.0])
def test_counters_that_wrap_around_are_named(around: float) -> None:
    seen = drive(turtlebot(), Imperfections())
    wheels = seen.wheels
    wrapped = replace(wheels, phi_R=np.mod(wheels.phi_R, around), phi_L=np.mod(wheels.phi_L, around))
    finding = counter_finding(wrapped)
    assert finding is not None
    assert "wrap around" in finding.text
    assert finding.size == pytest.approx(around, rel=0.05)
    assert counter_finding(wheels) is None
    # whether no wheels fit, nonsense that the likelihood refuses, or nonsense that it solves: never used, and named
    try:
        found = calibrate(read_by(seen, wrapped))
    except CalibError as error:
        refused = str(error)
    else:
        assert found.verdict is not None
        assert found.verdict.level is Level.REDO
        refused = " ".join(f.text for f in found.findings if f.blocks)
    assert re.search(r"readings jump \d+ times", refused)


def test_messages_that_are_missing_are_no_jumps() -> None:
    wheels = drive(khepera(), Imperfections()).wheels
    kept = np.arange(len(wheels)) % 100 < 85  # 0.3 s of every 2 s are missing
    gaps = replace(
        wheels, t_ns=wheels.t_ns[kept], phi_R=wheels.phi_R[kept], phi_L=wheels.phi_L[kept], covered=wheels.covered[kept]
    )
    assert counter_finding(gaps) is None


def test_fast_wheels_that_are_sampled_seldom_and_mostly_stand_do_not_jump() -> None:
    steps = np.zeros(1000)
    for leg in range(10):
        steps[100 * leg : 100 * leg + 4] = 0.8  # 8 rad/s at 10 Hz, for 0.4 s of every 10
    assert jumps(steps).size == 0
    steps[555] = 0.8
    assert jumps(steps).tolist() == [555]
    assert jumps(np.zeros(0)).size == 0


@pytest.mark.parametrize("at", [0, 1, 500, 998, 999])
def test_a_jump_is_found_wherever_in_the_log_it_is(at: int) -> None:
    steps = np.full(1000, 0.05)
    steps[at] = 3.0
    assert jumps(steps).tolist() == [at]


@pytest.mark.parametrize("kind", list(LossKind))
def test_what_a_recording_lost_is_never_good_and_comes_back_from_disk(kind: LossKind, tmp_path: Path) -> None:
    seen = drive(turtlebot(), Imperfections())
    loss = Loss(kind=kind, text="the recording is damaged: 3 chunks are lost")
    replace(seen, source=replace(seen.source, losses=(loss,))).save(tmp_path / "lost.npz")
    again = load_correspondences(tmp_path / "lost.npz")
    assert again.source.losses == (loss,)
    (finding,) = first_look([again], TARGET).findings
    assert finding.cause == kind
    reason = finding_reason(finding)
    assert reason.level is Level.USABLE
    assert reason.text == "The recording is damaged: 3 chunks are lost."
    assert reason.advice


def test_a_restart_of_fast_wheels_is_named() -> None:
    seen = drive(khepera(), Imperfections(wheels=WheelFaults(restart=(4, 3.0))))
    found, _ = estimate_explained([seen], None, EstimateOptions(target=TARGET))
    assert [f.cause for f in found.findings] == ["encoder-restart"]


def read_by(seen: Correspondences, wheels: WheelSamples) -> Correspondences:
    """Return a drive with other wheel readings, those at its stops too."""
    stops = tuple(
        replace(stop, phi_R=float(wheels.phi_R[stop.first_sample]), phi_L=float(wheels.phi_L[stop.first_sample]))
        for stop in seen.stops
    )
    return replace(seen, wheels=wheels, stops=stops)


def test_many_rejected_tags_are_named_and_never_good() -> None:
    seen = drive(turtlebot(), Imperfections())
    stops = tuple(replace(stop, rejected_tags=20 if j in {2, 5, 7} else 0) for j, stop in enumerate(seen.stops))
    finding = rejected_finding(stops)
    assert finding is not None
    assert finding.stops == (2, 5, 7)
    assert "60 of" in finding.text
    assert finding_reason(finding).level is Level.USABLE
    assert "tags-rejected" in causes(first_look([replace(seen, stops=stops)], TARGET))
    assert rejected_finding(seen.stops) is None
    assert rejected_finding([replace(seen.stops[0], rejected_tags=30)]) is None


def test_few_stops_with_impossible_wheels_do_not_say_swapped() -> None:
    seen = drive(turtlebot(), Imperfections(wheels=WheelFaults(counts=(-1.0, -1.0))))
    with pytest.raises(CalibError, match="4 stops are too few to tell why"):
        first_look([replace(seen, stops=seen.stops[:4])], TARGET)


def test_too_few_stops_whose_pictures_move_speak_of_the_clocks() -> None:
    seen = drive(turtlebot(), Imperfections())
    few = seen.stops[:2]
    with pytest.raises(CalibError, match=r"2 usable stops.*add stops"):
        first_look([replace(seen, stops=few)], TARGET)
    moving = tuple(replace(stop, cov_px2=np.tile(25.0 * np.eye(2), (len(stop.uv_px), 1, 1))) for stop in few)
    with pytest.raises(CalibError, match=r"2 usable stops, and at 2 of 2 stops the picture moves.*with one clock"):
        first_look([replace(seen, stops=moving)], TARGET)


def test_clocks_that_drift_apart_are_told_from_an_offset() -> None:
    late = clock_finding(None, (1, 4, 9), 12)
    assert late is not None
    assert not late.blocks
    drifting = clock_finding(None, (8, 9, 10, 11), 12)
    assert drifting is not None
    assert "from stop 9 of 12 on" in drifting.text
    assert "drift apart" in drifting.text
    assert drifting.blocks
    assert clock_finding(None, (3,), 12) is None


def test_a_box_as_described_is_left_alone() -> None:
    seen = drive(khepera(), Imperfections())
    gluing = find_gluing(seen.stops, seen.image_size, TARGET)
    assert gluing is not None
    assert gluing.as_described
    assert gluing.misfit_deg < 5
    look = first_look([seen], TARGET)
    assert look.target is TARGET
    assert causes(look) == []


def test_a_box_upside_down_is_found_and_the_result_is_right() -> None:
    robot = turtlebot()
    standing = rigid(exp_so3(np.array([pi, 0.0, 0.0])), np.array([0.0, 0.0, TARGET.box.height]))
    look = first_look([drive(robot, Imperfections(box=BoxFaults(standing=standing)))], TARGET)
    assert [f.cause for f in look.findings] == ["box-upside-down"]
    found = estimate(look.drives, look.steps)
    assert abs(found.rR - robot.rR) < 4 * found.sigma["rR"]
    assert np.linalg.norm(found.T_body_cam[:3, 3] - robot.T_body_cam[:3, 3]) < 2e-3


def test_a_box_on_its_side_is_refused_by_name() -> None:
    standing = rigid(exp_so3(np.array([pi / 2, 0.0, 0.0])), np.array([0.0, 0.1, 0.125]))
    with pytest.raises(CalibError, match="lies on its side"):
        first_look([drive(turtlebot(), Imperfections(box=BoxFaults(standing=standing)))], TARGET)


def test_a_camera_below_its_own_floor_is_never_used() -> None:
    raised = rigid(np.eye(3), np.array([0.0, 0.0, 0.13]))  # the Khepera's camera is 0.112 m high
    look = first_look([drive(khepera(), Imperfections(box=BoxFaults(standing=raised)))], TARGET)
    (finding,) = last_look(look, estimate(look.drives, look.steps))
    assert finding.cause == "below-floor"
    assert finding.blocks
    assert finding.size == pytest.approx(17.7, abs=1.5)


@pytest.mark.parametrize(
    ("right", "left", "said", "option"),
    [
        (-1.0, -1.0, "swapped", "--reverse-left --reverse-right"),
        (1.0, -1.0, "the left wheel's readings fall", "--reverse-left"),
        (-1.0, 1.0, "the right wheel's readings fall", "--reverse-right"),
    ],
)
def test_wheels_that_roll_the_wrong_way_are_named_with_the_fit(
    right: float, left: float, said: str, option: str
) -> None:
    seen = drive(turtlebot(), Imperfections(wheels=WheelFaults(counts=(right, left))))
    with pytest.raises(CalibError, match=said) as error:
        first_look([seen], TARGET)
    assert "agree to" in str(error.value)
    assert option in str(error.value)


@pytest.mark.parametrize("size", [(0.033, 0.16), (0.0209, 0.0891), (0.036, 0.235), (0.165, 0.555), (0.1, 0.7)])
def test_wheels_of_real_robots_are_in_rad(size: tuple[float, float]) -> None:
    r, b = size
    assert judge_units(r, r * 1.02, b, (0.0023, 0.0023)) is None
    degrees = judge_units(r * pi / 180, r * pi / 180, b, (0.13, 0.13))
    assert degrees is not None
    assert "--joint-unit deg" in degrees.advice
    ticks = judge_units(r / 652, r / 652, b, (1.0, 1.0))
    assert ticks is not None
    assert "--joint-unit ticks" in ticks.advice
    metres = judge_units(1.002, 1.001, b, (0.0001, 0.0001))
    assert metres is not None
    assert "--joint-unit m" in metres.advice
    assert all(f.blocks for f in (degrees, ticks, metres))


def test_turns_are_named() -> None:
    found = judge_units(0.033 * 2 * pi, 0.033 * 2 * pi, 0.16, (0.0004, 0.0004))
    assert found is not None
    assert "--joint-unit turns" in found.advice


def test_a_motor_before_a_gear_is_named_with_its_ratio() -> None:
    found = judge_units(0.033 / 30, 0.033 / 30, 0.16, (0.07, 0.07))
    assert found is not None
    assert "gear of about 29" in found.text


def test_one_wheel_that_counts_double_is_named() -> None:
    look = first_look([drive(turtlebot(), Imperfections(wheels=WheelFaults(counts=(2.0, 1.0))))], TARGET)
    (finding,) = last_look(look, estimate(look.drives, look.steps))
    assert finding.cause == "counts"
    assert finding.blocks
    assert "right wheel's readings count 2 times" in finding.text


def test_another_box_with_equal_tags_is_told_from_one_of_another_size() -> None:
    other = drive(turtlebot(), Imperfections(box=BoxFaults(other=Box(tag_size=0.024, pitch=0.033))))
    finding = other_layout(other.stops, TARGET)
    assert finding is not None
    assert finding.size == pytest.approx(0.024 / 0.033 / (0.028 / 0.035), abs=0.01)
    small = drive(turtlebot(), Imperfections(box=BoxFaults(scale=(0.97, 0.97))))
    assert other_layout(small.stops, TARGET) is None


def test_pictures_that_move_while_the_wheels_stand_speak_of_two_clocks() -> None:
    seen = drive(turtlebot(), Imperfections())
    stops = tuple(replace(s, cov_px2=s.cov_px2 + 25 * np.eye(2)) if j % 2 else s for j, s in enumerate(seen.stops))
    look = first_look([replace(seen, stops=stops)], TARGET)
    assert "clock" in causes(look)


@pytest.mark.parametrize("late", [-7.3, 20.0])
def test_the_offset_of_the_cameras_clock_is_found(late: float) -> None:
    seen = drive(turtlebot(), Imperfections())
    other = replace(seen, wheels=replace(seen.wheels, t_ns=seen.wheels.t_ns - round(late * 1e9)))
    camera = calibrate_camera(seen.stops, seen.image_size)
    assert find_offset(seen, camera) is None
    offset = find_offset(other, camera)
    assert offset is not None
    assert offset.late_s == pytest.approx(late, abs=0.7)  # half a stop: the robot stands
    finding = clock_finding(offset, (), len(seen.stops))
    assert finding is not None
    assert ("late" if late > 0 else "early") in finding.text


def _exchanged_and_reversed(seen: Correspondences) -> Correspondences:
    """The same drive as of a robot that drives backward."""
    wheels = replace(seen.wheels, phi_R=-seen.wheels.phi_L, phi_L=-seen.wheels.phi_R)
    stops = tuple(replace(stop, phi_R=-stop.phi_L, phi_L=-stop.phi_R) for stop in seen.stops)
    return replace(seen, wheels=wheels, stops=stops)


@pytest.mark.parametrize("frame", ["optical", "link"])
@pytest.mark.parametrize("exchanged", [False, True])
def test_wheels_that_are_exchanged_and_reversed_are_told_by_the_described_camera(frame: str, exchanged: bool) -> None:
    seen = drive(turtlebot(), Imperfections())
    T = turtlebot().T_body_cam.copy()
    if frame == "link":
        T[:3, :3] = T[:3, :3] @ np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # x along the view, z up
    source = replace(seen.source, base_frame="base_footprint", nominal_T_base_cam=tuple(T.ravel().tolist()))
    seen = replace(_exchanged_and_reversed(seen) if exchanged else seen, source=source)
    found = calibrate(seen, TARGET)
    assert found.verdict is not None
    assert found.verdict.level == (Level.USABLE if exchanged else Level.GOOD)
    assert [f.cause for f in found.findings if f.cause == "camera-direction"] == ["camera-direction"] * exchanged


@pytest.mark.parametrize("exchanged", [False, True])
def test_a_camera_that_looks_to_the_rear_is_said_to_be_unchecked(exchanged: bool) -> None:
    seen = drive(turtlebot(), Imperfections())
    found = calibrate(_exchanged_and_reversed(seen) if exchanged else seen, TARGET)
    assert found.verdict is not None
    assert [r.rule for r in found.verdict.reasons if r.rule == "direction"] == ["direction"] * exchanged


def on_a_floor(T_floor: Array | None, seed: int = 5) -> Correspondences:
    """Return a drive on a floor that lies elsewhere on one side of the box; the robot leans by chance as well."""
    rng = np.random.default_rng(seed)
    made = simulate_drive(turtlebot(), TARGET, DriveOptions(stops=14), rng, faults=Imperfections(lean=np.radians(0.05)))
    if T_floor is not None:
        floors = made.scene.T_box_floor.copy()
        floors[made.stop_poses[:, 0] > 0] = T_floor @ floors[made.stop_poses[:, 0] > 0]
        made = replace(made, scene=replace(made.scene, T_box_floor=floors))
    return seen_from(turtlebot(), TARGET, made, rng)


@pytest.mark.parametrize(
    ("T_floor", "uneven"),
    [
        (None, False),
        (rigid(np.eye(3), np.array([0.0, 0.0, 0.005])), True),
        (rigid(exp_so3(np.array([0.0, -np.radians(1.0), 0.0])), np.zeros(3)), True),
    ],
    ids=["flat", "a step of 5 mm", "a ramp of 1 deg"],
)
def test_a_floor_that_is_no_plane_is_said_and_never_good(T_floor: Array | None, uneven: bool) -> None:
    found = calibrate(on_a_floor(T_floor), TARGET)
    assert found.verdict is not None
    said = [f for f in found.findings if f.cause == "floor-uneven"]
    assert bool(said) == uneven
    assert all(f.size > 0.05 and not f.p_value > 1e-4 for f in said)
    assert (found.verdict.level is Level.GOOD) != uneven


def test_a_print_of_another_size_than_the_others_is_taken_as_it_is() -> None:
    seen = drive(khepera(), Imperfections(box=BoxFaults(face_scale=(1.0, 0.97, 1.0, 1.0))))
    told = replace(seen, source=replace(seen.source, print_sizes=(1.0, 0.97, 1.0, 1.0)))
    found = calibrate(told, TARGET)
    assert found.verdict is not None
    assert found.verdict.level is Level.USABLE
    assert [f.size for f in found.findings if f.cause == "odd-print"] == pytest.approx([-3.0])
    assert found.detail is not None
    sigma = found.detail.covariance.sigma
    robot = khepera()
    assert abs(found.wheels.rR - robot.rR) < 4 * sigma["rR"] < 0.01 * robot.rR
    assert abs(found.wheels.b - robot.b) < 4 * sigma["b"] < 0.01 * robot.b
    as_described = calibrate(seen, TARGET)
    assert as_described.verdict is not None
    assert as_described.verdict.level is Level.REDO
