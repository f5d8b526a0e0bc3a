"""The verdict: eight faulty drives and a good one, every rule at its limits, and the page that documents them."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import faulty
import numpy as np
import pytest

from boxcal.calib.assessment.causes import FOLLOWS
from boxcal.calib.assessment.estimate_rules import held_out_ratio
from boxcal.calib.assessment.limits import LIMITS, SYMBOLS, Limit, angle, length, percent, sentence
from boxcal.calib.assessment.print_scale import PrintScale
from boxcal.calib.assessment.verdict import judge, verdict
from boxcal.calib.console.judgement import judgement
from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import rigid, rot_z
from boxcal.calib.likelihood.estimate import Direction, FlaggedCorner
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Covariance, HeldOut
from boxcal.calib.results.verdict import Kind, Level, Verdict
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target

Calibrations = Callable[[str], Calibration]
Drives = Callable[[str], Correspondences]
DOCS = Path(__file__).resolve().parents[2] / "docs" / "report.md"


def _judged(name: str, calibrations: Calibrations, drives: Drives) -> Verdict:
    return judge(calibrations(name), drives(name), make_target())


def _faults(found: Verdict) -> set[str]:
    return {r.rule for r in found.reasons if r.level is not Level.GOOD}


def test_good_drive_is_good(calibrations: Calibrations, drives: Drives) -> None:
    found = _judged("good_drive", calibrations, drives)
    assert found.level is Level.GOOD
    assert _faults(found) == set()
    assert found.next_steps == (
        "Put it on the robot. Calibrate again after a new tyre, a knock on the camera or a change of its focus.",
    )


FAULTS = [
    ("few_stops", Level.REDO, "stops", "at least 12 stops"),
    ("one_side", Level.USABLE, "around", "all the way round the box"),
    ("slipped", Level.USABLE, "legs", "Drive slower"),
    ("box_moved", Level.USABLE, "legs", "Fasten the box"),
    ("wrong_print", Level.REDO, "print", "Measure the print"),
    ("blurred", Level.USABLE, "sharpness", "Stand still"),
]


@pytest.mark.parametrize(("fault", "level", "rule", "advice"), FAULTS)
def test_faulty_drive_is_recognised(
    fault: str, *, level: Level, rule: str, advice: str, calibrations: Calibrations, drives: Drives
) -> None:
    found = _judged(fault, calibrations, drives)
    assert found.level is level
    assert found.reasons[0].rule == rule
    assert advice in found.next_steps[0]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20, 26))
def test_other_drives_get_the_same_verdicts(seed: int) -> None:
    target = make_target()
    drive = faulty.good_drive(seed=seed)
    assert judge(faulty.calibrated(drive), drive, target).level is Level.GOOD
    for fault, level, rule, _ in FAULTS:
        drive = getattr(faulty, fault)(seed)
        found = judge(faulty.calibrated(drive), drive, target)
        assert (fault, found.level, found.reasons[0].rule) == (fault, level, rule)
    for fault in ("no_turn", "swapped_wheels"):
        with pytest.raises(CalibError):
            faulty.calibrated(getattr(faulty, fault)(seed))


@pytest.mark.parametrize(
    ("fault", "what", "do"),
    [
        ("no_turn", "largest turn between stops is", "add stops that face the box from other sides"),
        ("swapped_wheels", "left and right wheel joints are swapped", "exchange --left-joint and --right-joint"),
    ],
)
def test_drive_that_determines_nothing_is_refused_with_advice(
    fault: str, what: str, do: str, calibrations: Calibrations
) -> None:
    with pytest.raises(CalibError) as refused:
        calibrations(fault)
    found, _, advice = str(refused.value).partition("; ")
    assert what in found
    assert do in advice


def test_slip_and_pushed_box_are_told_apart(calibrations: Calibrations, drives: Drives) -> None:
    slip = _judged("slipped", calibrations, drives).reasons[0].text
    push = _judged("box_moved", calibrations, drives).reasons[0].text
    assert "stops 6 and 7" in slip
    assert "a wheel slipped" in slip
    assert "stops 7 and 8" in push
    assert "no slip explains it" in push
    moved = re.search(r"pushed by (\d+) mm and ([\d.]+)°", push)
    assert moved is not None
    assert float(moved[1]) == pytest.approx(36.1, abs=4)
    assert float(moved[2]) == pytest.approx(4.0, abs=0.4)


def test_wrong_print_asks_for_a_ruler_and_no_new_drive(calibrations: Calibrations, drives: Drives) -> None:
    found = _judged("wrong_print", calibrations, drives)
    assert "+1.0% across" in found.reasons[0].text
    assert len(found.next_steps) == 1
    assert "no new drive is needed" in found.next_steps[0]


def test_closed_form_is_never_good(calibrations: Calibrations) -> None:
    found = verdict(replace(calibrations("good_drive"), detail=None))
    assert found.level is Level.USABLE
    assert _faults(found) == {"uncertainty"}


def _with(c: Calibration, **changes: object) -> Calibration:
    assert c.detail is not None
    return replace(c, detail=replace(c.detail, **changes))  # type: ignore[arg-type]


def _ground(c: Calibration, **changes: float) -> Calibration:
    assert c.detail is not None
    return _with(c, ground=replace(c.detail.ground, **changes))


def _noise(c: Calibration, **changes: float) -> Calibration:
    assert c.detail is not None
    return _with(c, noise=replace(c.detail.noise, **changes))


def _covariance(c: Calibration, name: str, sigma: float) -> Calibration:
    assert c.detail is not None
    matrix = np.diag([1e-18] * 14)
    k = list(c.detail.covariance.sigma).index(name)
    matrix[k, k] = sigma**2
    return _with(c, covariance=Covariance(matrix=matrix))


def _turn_back(c: Calibration, largest_deg: float) -> Calibration:
    """All stops side by side, turned evenly by up to the angle."""
    T = c.stops[0].T_box_cam
    angles = np.radians(np.linspace(0, largest_deg, len(c.stops)))
    poses = [rigid(rot_z(float(a)) @ T[:3, :3], s.T_box_cam[:3, 3]) for a, s in zip(angles, c.stops, strict=True)]
    return replace(c, stops=tuple(replace(s, T_box_cam=T) for s, T in zip(c.stops, poses, strict=True)))


def _gap(c: Calibration, gap_deg: float) -> Calibration:
    """All stops evenly within what the gap leaves."""
    around = np.radians(np.linspace(0, 360 - gap_deg, len(c.stops)))
    poses = [
        rigid(s.T_box_cam[:3, :3], np.array([np.cos(a), np.sin(a), 0.2])) for a, s in zip(around, c.stops, strict=True)
    ]
    return replace(c, stops=tuple(replace(s, T_box_cam=T) for s, T in zip(c.stops, poses, strict=True)))


MAKERS: dict[str, Callable[[Calibration, float], Calibration]] = {
    "straight": lambda c, v: _ground(c, straight_position=v),
    "heading": lambda c, v: _ground(c, straight_heading=float(np.radians(v))),
    "turn": lambda c, v: _ground(c, turn_heading=float(np.radians(v))),
    "camera-angle": lambda c, v: _covariance(c, "ry", float(np.radians(v))),
    "camera-place": lambda c, v: _covariance(c, "ty", v),
    "around": _gap,
    "turned": lambda c, v: _turn_back(c, -v),
    "slip": lambda c, v: _noise(c, slip=v),
    "sharpness": lambda c, v: _noise(c, pixel_px=v),
    "fit": lambda c, v: _noise(c, pixel_factor=v),
    "floor": lambda c, v: replace(c, quality=replace(c.quality, up_error_rad=float(np.radians(v)))),
    "wheels": lambda c, v: replace(c, wheels=replace(c.wheels, rR=c.wheels.rL * (1 + v))),
    "moves": lambda c, v: replace(c, quality=replace(c.quality, sigma4_sigma3=-v)),
    "held-out": lambda c, v: _with(
        c, held_out=(HeldOut(drive=0, stop=1, error=(0.01 * v, -0.01 * v, 0.02 * v), sigma=(0.01, 0.01, 0.02)),)
    ),
}


@pytest.mark.parametrize("rule", MAKERS)
def test_rule_holds_at_both_of_its_limits(rule: str, calibrations: Calibrations) -> None:
    limit, good = LIMITS[rule], calibrations("good_drive")

    def level(value: float) -> Level:
        found = verdict(MAKERS[rule](good, value))
        return next(r.level for r in found.reasons if r.rule == rule)

    step = 0.01 * max(abs(limit.good), abs(limit.usable)) * 0.5
    assert level(limit.good - step) is Level.GOOD
    assert level(limit.good + step) is Level.USABLE
    assert level(limit.usable - step) is Level.USABLE
    if rule != "around":  # no gap is larger than all round
        assert level(limit.usable + step) is Level.REDO


@pytest.mark.parametrize(("stops", "level"), [(4, Level.REDO), (5, Level.USABLE), (7, Level.USABLE), (8, Level.GOOD)])
def test_number_of_stops_is_judged(stops: int, level: Level, calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    found = verdict(replace(c, stops=c.stops[:stops]))
    assert next(r.level for r in found.reasons if r.rule == "stops") is level


def test_many_faulty_legs_are_worse_than_one(calibrations: Calibrations) -> None:
    c = calibrations("slipped")
    assert c.detail is not None
    one = c.detail.flagged_legs
    assert verdict(c).level is Level.USABLE
    assert verdict(_with(c, flagged_legs=one * 4)).level is Level.REDO


def test_share_of_wrong_corners_is_judged(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    wrong = tuple(FlaggedCorner(drive=0, stop=0, landmark_id=i, error_px=(9.0, 0.0)) for i in range(4000))
    for share, level in ((0.02, Level.GOOD), (0.05, Level.USABLE), (0.2, Level.REDO)):
        found = verdict(_with(c, flagged_corners=wrong[: int(share * c.quality.landmarks)]))
        assert next(r.level for r in found.reasons if r.rule == "corners") is level


def test_stop_behind_a_faulty_leg_does_not_count_as_badly_predicted(calibrations: Calibrations) -> None:
    c = calibrations("slipped")
    assert c.detail is not None
    end = c.detail.flagged_legs[0].next_stop
    sigma = (0.01, 0.01, 0.02)
    far = HeldOut(drive=0, stop=end, error=(1.0, 1.0, 1.0), sigma=sigma)
    near = HeldOut(drive=0, stop=end + 1, error=(0.01, 0.01, 0.02), sigma=sigma)
    assert held_out_ratio(replace(c.detail, held_out=(far, near))) == pytest.approx(1.0)
    assert held_out_ratio(replace(c.detail, held_out=(far,))) is None
    assert held_out_ratio(replace(c.detail, held_out=(far, near), flagged_legs=())) > 40  # type: ignore[operator]
    assert verdict(_with(c, held_out=(far, near))).level is Level.USABLE
    assert all(r.rule != "held-out" for r in verdict(_with(c, held_out=(far,))).reasons)


def test_what_is_not_determined_forbids_use(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    open_ = Direction(
        parameters=(("b", 1.0),),
        sigma=np.inf,
        what="wheelbase is not determined by these stops",
        advice="add turns on the spot",
    )
    found = verdict(_with(c, directions=(open_,)))
    assert found.level is Level.REDO
    assert found.reasons[0].text == "Wheelbase is not determined by these stops."
    assert found.next_steps[0] == "Add turns on the spot."
    named = replace(open_, parameters=(("seat", 1.0), ("scale_x", 0.9)), what="seat and scale_x cannot be told apart")
    text = verdict(_with(c, directions=(named,))).reasons[0].text
    assert text == "All sheets higher than designed and print scale across cannot be told apart."
    weak = verdict(_with(c, directions=(replace(open_, sigma=2.0),)))
    assert weak.level is Level.USABLE


@pytest.mark.parametrize("name", ["straight_position", "straight_heading", "turn_heading"])
@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_unknown_ground_error_is_never_good(name: str, value: float, calibrations: Calibrations) -> None:
    assert verdict(_ground(calibrations("good_drive"), **{name: value})).level is Level.REDO


@pytest.mark.parametrize(
    ("x", "sigma", "level"),
    [(0.001, 1e-5, Level.GOOD), (0.003, 1e-4, Level.USABLE), (0.02, 1e-4, Level.REDO), (0.004, 0.002, Level.GOOD)],
)
def test_print_scale_counts_once_it_is_sure(x: float, sigma: float, level: Level, calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert verdict(c, PrintScale(x=x, y=0.0, sigma_x=sigma, sigma_y=sigma)).level is level
    assert verdict(c, PrintScale(x=0.0, y=-x, sigma_x=sigma, sigma_y=sigma)).level is level


def test_print_scale_that_was_estimated_is_no_fault(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    extra = {**c.detail.extra, "scale_x": 0.01, "scale_y": 0.0}
    sigma = {**c.detail.extra_sigma, "scale_x": 1e-4, "scale_y": 1e-4}
    found = verdict(_with(c, extra=extra, extra_sigma=sigma))
    assert found.level is Level.GOOD
    assert any("takes it into account" in r.text and r.kind is Kind.NOTE for r in found.reasons)


@pytest.mark.parametrize(
    ("x", "y", "level"), [(-0.02, -0.03, Level.USABLE), (-0.02, 0.01, Level.GOOD), (0.004, 0.02, Level.GOOD)]
)
def test_prints_that_are_off_alike_both_ways_may_be_right_on_a_box_of_another_size(
    x: float, y: float, level: Level, calibrations: Calibrations
) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    extra = {**c.detail.extra, "scale_x": x, "scale_y": y}
    sigma = {**c.detail.extra_sigma, "scale_x": 1e-4, "scale_y": 1e-4}
    found = verdict(_with(c, extra=extra, extra_sigma=sigma))
    assert found.level is level
    assert any(r.rule == "box-size" and "2.6%" in r.text for r in found.reasons) == (level is Level.USABLE)


def test_reasons_stand_worst_first_and_every_fault_has_advice(calibrations: Calibrations, drives: Drives) -> None:
    for name in ("few_stops", "one_side", "slipped", "box_moved", "wrong_print", "blurred"):
        found = _judged(name, calibrations, drives)
        told = [r.level is not Level.GOOD for r in found.reasons]
        assert told == sorted(told, reverse=True)
        assert found.level is max((r.level for r in found.reasons), key=lambda level: level.rank)
        for reason in found.reasons:
            assert bool(reason.advice) == (reason.level is not Level.GOOD)
            assert not reason.text[0].islower() or reason.text.split()[0].rstrip(",") in SYMBOLS
            assert reason.text.endswith(".")


def test_limit_takes_nothing_unknown_for_good() -> None:
    limit = Limit(good=1.0, usable=2.0)
    assert [limit.grade(v) for v in (1.0, 1.1, 2.0, 2.1, np.inf, np.nan)] == [
        Level.GOOD,
        Level.USABLE,
        Level.USABLE,
        Level.REDO,
        Level.REDO,
        Level.REDO,
    ]


def test_figures_are_said_as_people_say_them() -> None:
    assert [length(v) for v in (0.00002, 0.0012, 0.034, 2.5, np.inf)] == [
        "0.02 mm",
        "1.2 mm",
        "3.4 cm",
        "2.5 m",
        "an unknown length",
    ]
    assert [angle(v) for v in (0.0123, 0.5, 12.0, np.nan)] == ["0.012°", "0.50°", "12.00°", "an unknown angle"]
    assert [percent(v) for v in (0.012, -0.012, 0.0001)] == ["+1.2%", "\N{MINUS SIGN}1.2%", "0.0%"]


def test_stops_of_one_spot_leave_everything_open(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    same = tuple(replace(s, T_box_cam=c.stops[0].T_box_cam) for s in c.stops)
    faults = {r.rule: r.level for r in verdict(replace(c, stops=same)).reasons}
    assert faults["around"] is Level.USABLE
    assert faults["turned"] is Level.REDO


def test_documentation_names_every_rule_and_its_limits() -> None:
    rows = dict(re.findall(r"^\| `([a-z-]+)` \| (.*)$", DOCS.read_text(encoding="utf-8"), re.MULTILINE))
    assert set(rows) == {*LIMITS, "open", "uncertainty", "misfit", "box-size"}
    factor = {
        "straight": 100,
        "camera-place": 1000,
        "slip": 1000,
        "print": 100,
        "legs": 100,
        "corners": 100,
        "wheels": 100,
    }
    for rule, limit in LIMITS.items():
        good, usable = (float(x) for x in re.findall(r"[\d.]+", rows[rule].split("|")[0])[:2])
        scale = factor.get(rule, 1)
        assert (good, usable) == pytest.approx((abs(limit.good) * scale, abs(limit.usable) * scale)), rule


def _finding(**changes: Any) -> Finding:
    plain = Finding(
        cause="eccentric-right", text="the right wheel is 1.0 ± 0.1 % out of round", advice="true the wheel"
    )
    return replace(plain, **changes)


def test_a_cause_is_told_once_with_what_follows_folded_under_it(calibrations: Calibrations, drives: Drives) -> None:
    found = _judged("wrong_print", calibrations, drives)
    assert [r.rule for r in found.causes] == ["print"]
    follow = [r for r in found.reasons if r.because]
    assert len(follow) >= 4
    assert {r.because for r in follow} == {"print"}
    assert found.reasons[1 : 1 + len(follow)] == tuple(follow)
    assert len(found.next_steps) == 1
    assert "measure-target" in found.next_steps[0]
    assert re.fullmatch(r"\d+ checks passed; 1 did not; \d+ more follow from it", found.count)


def test_every_rule_that_can_fail_has_its_place_among_the_causes() -> None:
    assert {*LIMITS, "uncertainty", "open"} <= set(FOLLOWS)
    order = list(FOLLOWS)
    for rule, follow in FOLLOWS.items():
        assert all(order.index(f) > order.index(rule) for f in follow), rule


def test_what_was_solved_for_is_a_note_and_no_fault(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    found = verdict(replace(c, findings=(_finding(adopted=True),)))
    assert found.level is Level.GOOD
    notes = [r.text for r in found.notes if r.rule != "ruler"]
    assert notes == ["The right wheel is 1.0 ± 0.1 % out of round; taken into account."]


def test_sigmas_that_do_not_trust_the_model_keep_a_result_from_being_good(calibrations: Calibrations) -> None:
    c = calibrations("good_drive")
    assert c.detail is not None
    assert c.detail.leave_one_out is not None
    ratio = tuple(9.0 if name == "b" else 1.0 for name in ORDER)
    off = replace(c.detail.leave_one_out, ratio=ratio, unexplained=True)
    found = verdict(_with(c, leave_one_out=off))
    assert found.level is Level.USABLE
    assert "the wheel separation by 9 times" in found.causes[0].text
    explained = verdict(replace(_with(c, leave_one_out=off), findings=(_finding(),)))
    assert [r.because for r in explained.reasons if r.rule == "misfit"] == ["eccentric-right"]


def test_a_leg_whose_cause_is_named_is_told_once(calibrations: Calibrations) -> None:
    c = calibrations("slipped")
    assert c.detail is not None
    leg = c.detail.flagged_legs[0]
    named = replace(c, findings=(_finding(cause="leg-slipped", adopted=True, stops=(leg.leg, leg.next_stop)),))
    found = verdict(named)
    assert all(r.level is Level.GOOD for r in found.reasons if r.rule == "legs")
    assert [r.rule for r in found.notes if r.rule != "ruler"] == ["leg-slipped"]


@pytest.mark.parametrize(("blocks", "level"), [(False, Level.USABLE), (True, Level.REDO)])
def test_a_named_cause_that_is_left_is_never_good(blocks: bool, level: Level, calibrations: Calibrations) -> None:
    c = replace(calibrations("good_drive"), findings=(_finding(blocks=blocks),))
    found = verdict(c)
    assert found.level is level
    assert found.reasons[0].rule == "eccentric-right"
    assert found.next_steps[0] == "True the wheel."
    assert c.detail is not None
    blurred = verdict(_with(c, noise=replace(c.detail.noise, pixel_factor=3.0)))
    assert [r.because for r in blurred.reasons if r.rule == "fit"] == ["eccentric-right"]


def test_a_check_that_could_not_be_made_is_said_and_is_no_failure(calibrations: Calibrations, drives: Drives) -> None:
    found = _judged("blurred", calibrations, drives)
    assert [r.rule for r in found.unchecked] == ["print"]
    assert "could not be checked" in found.unchecked[0].text
    assert found.count.endswith("1 could not be made")


def test_symbols_keep_their_case_at_the_start_of_a_sentence() -> None:
    texts = [
        "kr is known badly",
        "rR, rL and b cannot be told apart",
        "face1_tx is open",
        "wheel b is loose",
        "b is open",
    ]
    assert [sentence(t) for t in texts] == [
        "kr is known badly.",
        "rR, rL and b cannot be told apart.",
        "face1_tx is open.",
        "Wheel b is loose.",
        "b is open.",
    ]


def test_the_terminal_says_causes_first_and_fits_eighty_columns(calibrations: Calibrations, drives: Drives) -> None:
    text = judgement("r01", _judged("wrong_print", calibrations, drives))
    lines = text.splitlines()
    assert lines[0].startswith("r01: REDO - ")
    assert next(line for line in lines if line.startswith("  ") and line[2] != " ").startswith(
        "  why: The print is not"
    )
    assert any(line.startswith("    so: ") for line in lines)
    assert any(line.startswith("  do: Measure the print") for line in lines)
    assert all(len(line) <= 80 for line in lines)
