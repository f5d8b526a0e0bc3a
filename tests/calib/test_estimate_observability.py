"""What a drive leaves open is said in words, and nothing open gets a finite sigma."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.likelihood.estimator import estimate, fit
from boxcal.calib.likelihood.observability import open_directions
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target

STEP = radians(0.1302)


def drive_through(stops: list[tuple[float, float, float]], seed: int = 0) -> Correspondences:
    rng = np.random.default_rng(seed)
    options = DriveOptions(stops=len(stops), slip=3e-4, encoder_step=STEP, steps_per_sample=2)
    drive = simulate_drive(khepera(), make_target(), options, rng, stops=np.array(stops))
    return exact_correspondences(khepera(), make_target(), drive, 0.2, rng)


def test_good_drive_leaves_nothing_open() -> None:
    rng = np.random.default_rng(1)
    drive = simulate_drive(khepera(), make_target(), DriveOptions(stops=12, encoder_step=STEP, steps_per_sample=2), rng)
    found = estimate([exact_correspondences(khepera(), make_target(), drive, 0.2, rng)])
    assert found.directions == ()
    assert np.all(np.isfinite(found.cov))


def test_stops_that_all_look_the_same_way_leave_yaw_and_place_of_the_camera_open() -> None:
    stops = [(0.55 + 0.06 * k, 0.12 * np.sin(2.0 * k), np.pi + 0.002 * (-1) ** k) for k in range(8)]
    try:
        found = estimate([drive_through(stops)])
    except CalibError as error:
        assert "stops" in str(error) or "legs" in str(error)  # noqa: PT017
        return
    text = " ".join(d.text for d in found.directions)
    assert "known badly" in text or "cannot be told apart" in text
    assert found.directions[0].sigma > 1


def test_null_direction_of_the_information_is_named_and_gets_no_finite_sigma() -> None:
    rng = np.random.default_rng(2)
    drive = simulate_drive(khepera(), make_target(), DriveOptions(stops=8, encoder_step=STEP, steps_per_sample=2), rng)
    done = fit([exact_correspondences(khepera(), make_target(), drive, 0.2, rng)])
    best = int(np.argmax(done.profile.weight))
    information = done.profile.solution.information[best].copy()
    b = ORDER.index("b")
    information[b, :] = information[:, b] = 0.0
    directions, unknown = open_directions(done.problem, done.state, information)
    assert np.isinf(directions[0].sigma)
    assert directions[0].parameters[0][0] == "b"
    assert (
        directions[0].text == "b is not determined by these stops; add turns on the spot, to the left and to the right"
    )
    assert [done.problem.names[k] for k in np.flatnonzero(unknown)] == ["b"]


def test_unknown_that_only_its_prior_decides_is_said() -> None:
    rng = np.random.default_rng(3)
    target = make_target()
    drive = simulate_drive(khepera(), target, DriveOptions(stops=6, encoder_step=STEP, steps_per_sample=2), rng)
    data = exact_correspondences(khepera(), target, drive, 0.2, rng)
    found = estimate([data], None, EstimateOptions(target=target, ink_sigma=1e-7))
    assert any(note.startswith("the drive hardly determines ink") for note in found.notes)
    assert found.extra_sigma["ink"] == pytest.approx(1e-7, rel=0.1)


def test_stops_left_out_by_the_camera_step_are_driven_through() -> None:
    rng = np.random.default_rng(4)
    drive = simulate_drive(khepera(), make_target(), DriveOptions(stops=8, encoder_step=STEP, steps_per_sample=2), rng)
    data = exact_correspondences(khepera(), make_target(), drive, 0.2, rng)
    s = data.stops[3]
    blind = replace(
        s,
        landmark_ids=s.landmark_ids[:4],
        p_box=s.p_box[:4],
        uv_px=s.uv_px[:4],
        cov_px2=s.cov_px2[:4],
        faces=s.faces[:4],
    )
    found = estimate([replace(data, stops=(*data.stops[:3], blind, *data.stops[4:]))])
    assert found.drives[0].stops == (0, 1, 2, 4, 5, 6, 7)
    assert len(found.drives[0].leg_p_values) == 6
    problem = build_problem([data], [(0, 1, 2, 4)], EstimateOptions(), STEP)
    assert problem.path.legs == 3
