"""The estimate grows with each stop: at once, and to what a full solution says."""

import time
from dataclasses import replace

import numpy as np
import pytest
from drives import TARGET, seen

from boxcal.calib.errors import CalibError
from boxcal.calib.guide.estimate.running import RunningEstimate
from boxcal.calib.likelihood.estimator import fit, reported
from boxcal.calib.likelihood.grown_fit import grown_fit
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.simulate.imperfections import WheelFaults

_OPTIONS = EstimateOptions(lens=None, target=TARGET)


def test_a_stop_more_gives_the_full_solution_in_a_fraction_of_its_time() -> None:
    drive = seen(30)
    known = fit([replace(drive, stops=drive.stops[:29])], None, _OPTIONS)
    times = {"grown": [], "full": []}  # type: dict[str, list[float]]
    for _ in range(3):
        begun = time.process_time()
        grown = reported(grown_fit(known, drive), [drive], _OPTIONS)
        middle = time.process_time()
        full = reported(fit([drive], None, _OPTIONS), [drive], _OPTIONS)
        times["grown"].append(middle - begun)
        times["full"].append(time.process_time() - middle)
    sigma = np.array(list(full.sigma.values()))
    difference = np.array([grown.rR - full.rR, grown.rL - full.rL, grown.b - full.b]) / sigma[5:8]
    assert np.all(np.abs(difference) < 0.1)
    assert np.allclose(np.array(list(grown.sigma.values())), sigma, rtol=0.15)
    assert min(times["grown"]) < 0.5 * min(times["full"])


def test_a_stop_measured_anew_is_taken_as_it_is_now() -> None:
    drive = seen(8)
    fewer = replace(
        drive.stops[3],
        landmark_ids=drive.stops[3].landmark_ids[:-4],
        faces=drive.stops[3].faces[:-4],
        p_box=drive.stops[3].p_box[:-4],
        uv_px=drive.stops[3].uv_px[:-4],
        cov_px2=drive.stops[3].cov_px2[:-4],
    )
    before = replace(drive, stops=(*drive.stops[:3], fewer, *drive.stops[4:7]))
    grown = grown_fit(fit([before], None, _OPTIONS), drive)
    assert len(grown.problem.uv_px) == sum(len(s.landmark_ids) for s in drive.stops)
    full = fit([drive], None, _OPTIONS)
    sigma = np.sqrt(np.diag(full.cov)[5:8])
    assert np.all(np.abs(grown.state.wheels - full.state.wheels) < 0.2 * sigma)


def test_a_slipped_wheel_is_named_with_the_stop_that_shows_it() -> None:
    drive = seen(12, wheels=WheelFaults(slipped=(10, 0.03, 0.0)))
    known = fit([replace(drive, stops=drive.stops[:11])], None, _OPTIONS)
    found = reported(grown_fit(known, drive), [drive], _OPTIONS)
    assert [leg.leg for leg in found.flagged_legs] == [10]
    before = reported(known, [replace(drive, stops=drive.stops[:11])], _OPTIONS)
    assert found.sigma["b"] < 1.2 * before.sigma["b"], "the sound legs count as before"


def test_solutions_of_several_drives_do_not_grow() -> None:
    drive = seen(6)
    known = fit([drive, drive], None, _OPTIONS)
    with pytest.raises(CalibError, match="2 drives"):
        grown_fit(known, drive)


def test_a_running_estimate_says_what_it_lacks_and_then_grows() -> None:
    drive = seen(7)
    running = RunningEstimate(TARGET)
    assert not running.grow(replace(drive, stops=drive.stops[:2]))
    assert "2 of 3 stops" in running.problem
    for n in range(3, 8):
        running.grow(replace(drive, stops=drive.stops[:n]))
    assert running.estimate is not None
    assert not running.problem
    assert running.drive is not None
    assert len(running.estimate.drives[0].stops) == 7


def test_a_picture_that_froze_is_left_out_while_the_drive_grows() -> None:
    """Stops of a frozen picture lose their corners, not their number; those after it keep their own pictures."""
    drive = seen(9)
    third, fourth = drive.stops[2:4]
    frozen = replace(
        fourth,
        landmark_ids=third.landmark_ids,
        faces=third.faces,
        p_box=third.p_box,
        uv_px=third.uv_px,
        cov_px2=third.cov_px2,
    )
    drive = replace(drive, stops=(*drive.stops[:3], frozen, *drive.stops[4:]))
    running = RunningEstimate(TARGET)
    for n in range(3, 10):
        running.grow(replace(drive, stops=drive.stops[:n]))
    sound = replace(drive, stops=(*drive.stops[:3], *drive.stops[4:]))
    full = reported(fit([sound], None, _OPTIONS), [sound], _OPTIONS)
    assert running.estimate is not None
    assert abs(running.estimate.b - full.b) < 0.2 * full.sigma["b"]
    assert running.drive is not None
    assert running.seen is not None
    assert [n for n, stop in enumerate(running.drive.stops) if not len(stop.landmark_ids)] == [3]
    assert all(len(stop.landmark_ids) for stop in running.seen.stops)


def test_a_stop_that_the_wheels_no_longer_show_is_no_longer_solved_for() -> None:
    """A nudge takes back a stop in the middle: those after it move up, and their poses with them."""
    drive = seen(9)
    running = RunningEstimate(TARGET)
    for n in range(3, 8):
        running.grow(replace(drive, stops=drive.stops[:n]))
    fewer = replace(drive, stops=(*drive.stops[:3], *drive.stops[4:]))
    assert running.grow(fewer)
    full = reported(fit([fewer], None, _OPTIONS), [fewer], _OPTIONS)
    assert running.estimate is not None
    assert abs(running.estimate.b - full.b) < 1e-6 * full.b
