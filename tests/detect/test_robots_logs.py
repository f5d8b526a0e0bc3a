"""Logs in the topics, types and names that public robots publish: each gives the wheels that were driven."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from robot_logs import (
    BLANKS,
    DRIVER,
    ROBOTS,
    Angles,
    Message,
    images,
    joint_state,
    joints,
    write_mcap,
    zeros,
)
from small_logs import LEFT, RIGHT, T0_NS, drive

from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.signals import Quantity
from boxcal.detect.log.wheel_samples import JointUnit


def _angles(**how: float) -> Angles:
    t_ns, phi_R, phi_L, _ = drive(step=0, **how)  # type: ignore[arg-type]
    return t_ns, phi_R, phi_L


def _check(found: Recording, angles: Angles, tick: float = 1e-9) -> None:
    """Hold the wheels to those that were driven, up to the encoder's tick."""
    t_ns, phi_R, phi_L = angles
    wheels = found.wheels
    assert len(wheels) > 0.9 * len(t_ns)
    right, left = (np.interp(wheels.t_ns - T0_NS, t_ns - T0_NS, phi) for phi in (phi_R, phi_L))
    for seen, true in ((wheels.phi_R, right), (wheels.phi_L, left)):
        assert np.max(np.abs((seen - seen[0]) - (true - true[0]))) <= 1.01 * tick + 1e-9
    assert np.all(wheels.covered)
    assert found.frame_t_ns.size == 4


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robots_own_topics_give_the_wheels_that_were_driven(tmp_path: Path, robot: str) -> None:
    angles, row = _angles(), ROBOTS[robot]
    found = open_recording(row.log(tmp_path / "a.mcap", angles), row.topics, row.units, row.nominal)
    metres = row.units is not None and row.units.unit is JointUnit.METRES
    right = tuple(DRIVER[0] * a for a in angles[1:]) if metres else angles[1:]
    _check(found, (angles[0], *right), row.tick or (1e-4 if row.driver else 1e-9))
    assert found.camera_topic == (row.cameras[0][0] if row.write is None else "/duckie/camera_node/image")
    if row.tick > 1e-3:
        assert found.wheels.encoder_steps == pytest.approx([row.tick] * 2, rel=1e-6)


def _notes(tmp_path: Path, robot: str) -> tuple[str, ...]:
    row = ROBOTS[robot]
    return open_recording(row.log(tmp_path / "a.mcap", _angles()), row.topics, row.units, row.nominal).notes


@pytest.mark.parametrize(
    ("robot", "sentence"),
    [
        ("TurtleBot 4", "/joint_states never move"),
        ("linorobot2", "/joint_states never move"),
        ("e-puck2", "corrections to these"),
        ("Husky", "effective"),
        ("six wheels", "3 right and 3 left wheels were averaged"),
        ("Int32 counters", "carry no stamps"),
    ],
)
def test_what_was_chosen_is_said(tmp_path: Path, robot: str, sentence: str) -> None:
    assert any(sentence in note for note in _notes(tmp_path, robot))


def test_a_robot_with_one_kind_of_wheels_has_nothing_to_say(tmp_path: Path) -> None:
    assert not _notes(tmp_path, "Andino")


def test_without_the_drivers_wheels_odometry_gives_ratios_and_says_so(tmp_path: Path) -> None:
    angles = _angles()
    found = open_recording(ROBOTS["LIMO"].log(tmp_path / "a.mcap", angles))
    assert found.quantity is Quantity.ODOMETRY
    assert any("the sizes mean nothing" in note for note in found.notes)
    s = (found.wheels.phi_R + found.wheels.phi_L)[-1] * 0.05
    assert s == pytest.approx(DRIVER[0] * np.sum([p[-1] - p[0] for p in angles[1:]]), rel=1e-4)


@pytest.mark.parametrize("what", ["robot's description", "driver's parameters"])
def test_what_the_log_says_of_the_driver_gives_the_wheels_of_its_odometry(tmp_path: Path, what: str) -> None:
    row = ROBOTS[f"odometry beside its {what}"]
    assert open_recording(row.log(tmp_path / "a.mcap", _angles())).nominal == pytest.approx(DRIVER)


@pytest.mark.parametrize("robot", ["Kobuki (/sensors/core)", "Int16 counters"])
def test_counters_of_sixteen_bits_run_over(tmp_path: Path, robot: str) -> None:
    angles, row = _angles(stops=8, stand=0.6, move=8.0), ROBOTS[robot]
    path = row.log(tmp_path / "a.mcap", angles)
    wheels = open_recording(path, units=row.units).wheels
    for seen, true in ((wheels.phi_R, angles[1]), (wheels.phi_L, angles[2])):
        assert np.max(np.abs((seen - seen[0]) - (true - true[0]))) < 2.1 * row.tick


def test_bare_counters_need_the_ticks_in_a_turn(tmp_path: Path) -> None:
    path = ROBOTS["Int32 counters"].log(tmp_path / "a.mcap", _angles())
    with pytest.raises(DetectError, match=r"whole numbers .*: encoder ticks, not radians.*--ticks-per-turn"):
        open_recording(path)


def test_wheels_without_sides_in_their_names_are_asked_for(tmp_path: Path) -> None:
    path = ROBOTS["wheels without a side in their names"].log(tmp_path / "a.mcap", _angles())
    with pytest.raises(DetectError, match=r"no wheel joints in /joint_states \(found: wheel0, wheel1\); name them"):
        open_recording(path)


def test_velocities_are_integrated_where_positions_stay_zero_and_said(tmp_path: Path) -> None:
    angles = _angles(rate_hz=200.0)
    speeds = [np.gradient(phi, (angles[0] - T0_NS) / 1e9) for phi in angles[1:]]

    def still() -> Iterator[Message]:
        for t, right, left in zip(angles[0], *speeds, strict=True):
            yield joint_state("/joint_states", t, [LEFT, RIGHT], [0.0, 0.0], [left, right])

    found = open_recording(write_mcap(tmp_path / "a.mcap", still(), images(BLANKS)))
    _check(found, angles, 2e-3)
    assert found.quantity is Quantity.VELOCITY
    assert any("integrated velocities" in note for note in found.notes)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("wheel_FL", "wheel_FR"),
        ("motor_left", "motor_right"),
        ("left_track", "right_track"),
        ("drivewhl_l_joint", "drivewhl_r_joint"),
        ("joint_left_wheel", "joint_right_wheel"),
    ],
)
def test_names_in_robots_habits_are_wheels(tmp_path: Path, left: str, right: str) -> None:
    angles = _angles()
    parts = joints("/joint_states", angles, [left, right], ["gripper_left_finger", "left_arm_motor"])
    _check(open_recording(write_mcap(tmp_path / "a.mcap", parts, images(BLANKS))), angles)


def test_two_publishers_on_one_topic_are_told_apart_and_said(tmp_path: Path) -> None:
    angles = _angles()
    late = zeros("/joint_states", (angles[0] + 7_000_000, *angles[1:]), [LEFT, RIGHT])
    both = (joints("/joint_states", angles, [LEFT, RIGHT]), late)
    found = open_recording(write_mcap(tmp_path / "a.mcap", *both, images(BLANKS)))
    _check(found, angles)
    assert any("has two publishers" in note for note in found.notes)


def _once_a_second(angles: Angles) -> Iterator[Message]:
    return joints("/joint_states", (angles[0][::50], angles[1][::50], angles[2][::50]), [LEFT, RIGHT])


CAUSES: dict[str, tuple[Callable[[Angles], Iterator[Message]], str]] = {
    "wheels never move": (lambda a: zeros("/joint_states", a, [LEFT, RIGHT]), r"the wheels \(.*\) never move"),
    "joints at 1 Hz": (_once_a_second, r"come at 1 Hz, 3 Hz at least"),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_each_cause_has_its_own_sentence(tmp_path: Path, cause: str) -> None:
    wheels, sentence = CAUSES[cause]
    with pytest.raises(DetectError, match=sentence):
        open_recording(write_mcap(tmp_path / "a.mcap", wheels(_angles(stops=8)), images(BLANKS)))


def test_all_problems_of_a_log_are_told_in_one_run(tmp_path: Path) -> None:
    path = write_mcap(
        tmp_path / "a.mcap",
        zeros("/joint_states", _angles(), [LEFT, RIGHT]),
        images(BLANKS, ("/a", "mono8"), ("/b", "mono8")),
    )
    with pytest.raises(DetectError, match=r"a.mcap: 2 camera topics .*; and the wheels .* never move"):
        open_recording(path)


def test_an_arms_broken_topic_harms_nothing_and_is_noted(tmp_path: Path) -> None:
    angles = _angles()
    arm = (joint_state("/arm/joint_states", t, ["a", "b"], [1.0]) for t in angles[0])
    found = open_recording(
        write_mcap(tmp_path / "a.mcap", joints("/joint_states", angles, [LEFT, RIGHT]), arm, images(BLANKS))
    )
    _check(found, angles)
    assert found.notes == ("not used, and not all of their messages decode: /arm/joint_states",)
    assert not found.losses
