"""compare-calibrations: what differs, what that means, and whether chance explains it."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import EVIL, SIGMA, calibration, camera, detail

from boxcal.calib.compare.cli import main
from boxcal.calib.compare.difference import difference, projection_shift
from boxcal.calib.compare.text import comparison
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.report.fleet_tables import PARAMETERS, robot_row
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.json_format import save_calibration
from boxcal.calib.results.verdict import Kind, Level, Reason, Verdict
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel

PLAIN = detail()


def _moved(d: Array, **changes: Any) -> Calibration:
    """A calibration off by d in the order and with the side of the covariance."""
    c = calibration()
    k, w, T = c.camera, c.wheels, c.T_body_cam
    return calibration(
        camera=CameraModel(**{n: getattr(k, n) + d[ORDER.index(n)] for n in ("fu", "fv", "cu", "cv", "kr")}),
        wheels=Wheels(**{n: getattr(w, n) + d[ORDER.index(n)] for n in ("rR", "rL", "b")}),
        T_body_cam=rigid(T[:3, :3] @ exp_so3(d[8:11]), T[:3, 3] + d[11:]),
        **{"detail": PLAIN, **changes},
    )


def test_causes_that_were_taken_into_account_are_compared_too() -> None:
    scrub = Finding(cause="scrub", text="the wheels scrub in turns", adopted=True)
    note = Reason(rule="scrub", level=Level.GOOD, text="The wheels scrub in turns; taken into account.", kind=Kind.NOTE)
    good = Verdict(level=Level.GOOD, headline="Put it on the robot.", reasons=(note,), next_steps=("drive",))
    a, b = _moved(np.zeros(14)), _moved(np.zeros(14), findings=(scrub,), verdict=good)
    text = comparison(a, b, difference(a, b))
    assert "note: The wheels scrub in turns; taken into account." in text
    assert text.count("GOOD") == 1
    row = robot_row(b, good, np.zeros(len(PARAMETERS)), np.zeros(len(PARAMETERS), dtype=bool), "")
    assert row.why == "Note: The wheels scrub in turns; taken into account."


def test_the_test_keeps_its_level_and_its_covariance_its_side() -> None:
    """2000 pairs drawn from the covariances differ beyond chance in 5 %, and chi-square has its mean and variance."""
    rng = np.random.default_rng(3)
    L = np.linalg.cholesky(PLAIN.covariance.matrix)
    found = [difference(_moved(L @ rng.normal(size=14)), _moved(L @ rng.normal(size=14))) for _ in range(2000)]
    chi2 = np.array([f.chi2 for f in found])
    p = np.array([f.p_value for f in found])
    assert abs(np.mean(p < 0.05) - 0.05) < 3 * np.sqrt(0.05 * 0.95 / 2000)
    assert abs(chi2.mean() - 14) < 4 * np.sqrt(28 / 2000)
    assert abs(chi2.var() - 28) < 5
    z = np.array([f.values / f.sigma for f in found if f.sigma is not None])
    assert np.all(np.abs(z.std(axis=0) - 1) < 0.07)


def test_a_difference_is_found_with_its_size() -> None:
    d = 8 * SIGMA * np.where(np.arange(14) == 9, 1, 0)
    found = difference(calibration(detail=PLAIN), _moved(d))
    np.testing.assert_allclose(found.values, d, atol=1e-12)
    assert found.sigma is not None
    assert found.values[9] / found.sigma[9] == pytest.approx(8 / np.sqrt(2))
    assert found.p_value is not None
    assert found.p_value < 1e-3


def test_undetermined_parameters_are_left_out_of_the_test() -> None:
    unknown = np.where(np.arange(14) == 7, np.inf, SIGMA)
    with np.errstate(invalid="ignore"):
        made = detail(unknown)
    far = _moved(np.where(np.arange(14) == 7, 1.0, 0.0), detail=made)
    found = difference(calibration(detail=PLAIN), far)
    assert (found.dof, found.p_value) == (13, 1.0)


def test_the_ground_sees_what_wheels_and_camera_do_otherwise() -> None:
    a = calibration()
    ratio = replace(a, wheels=replace(a.wheels, rR=a.wheels.rR * 1.01, rL=a.wheels.rL * 1.01))
    g = difference(a, ratio).ground
    assert g.straight_position == pytest.approx(0.1)
    assert g.turn_heading == pytest.approx(2 * np.pi * 0.01)
    wide = replace(a, wheels=replace(a.wheels, b=a.wheels.b * 1.01))
    assert difference(a, wide).ground.turn_heading == pytest.approx(2 * np.pi * (1 / 1.01 - 1))
    assert difference(a, wide).ground.straight_position == pytest.approx(0)
    curved = replace(a, wheels=replace(a.wheels, rR=a.wheels.rR * 1.001))
    g = difference(a, curved).ground
    assert g.straight_heading == pytest.approx(0.01 / a.wheels.b)
    assert g.straight_position == pytest.approx(10 * g.straight_heading / 2, rel=2e-3)
    shifted = replace(a, camera=replace(a.camera, cu=a.camera.cu + 3, cv=a.camera.cv - 4))
    g = difference(a, shifted).ground
    assert (g.projection_mean_px, g.projection_worst_px) == (pytest.approx(5), pytest.approx(5))
    rolled = replace(a, T_body_cam=a.T_body_cam @ rigid(exp_so3(np.array([0, 0, 0.01])), np.zeros(3)))
    assert projection_shift(a, rolled, 1.0).max() == pytest.approx(0.01 * 400, rel=0.02)


def test_richer_lenses_are_compared_in_pixels() -> None:
    extra = {"k2": 0.05, "p1": 1e-3, "p2": 0.0, "k3": 0.0}
    a = calibration(camera=camera("brown", **extra), detail=PLAIN)
    same = difference(a, a)
    assert same.ground.projection_worst_px < 1e-3
    assert same.p_value == 1.0
    b = calibration(detail=PLAIN)
    unlike = difference(a, b)  # coefficients of unlike models mean unlike things: wheels and extrinsics are left
    assert unlike.dof == 9
    assert unlike.p_value == 1.0
    assert unlike.ground.projection_worst_px > 1
    assert "camera models differ (A brown, B radial)" in comparison(a, b, unlike)


def test_causes_of_a_verdict_that_is_not_good_are_told() -> None:
    reason = Reason(rule="slip", level=Level.REDO, text="The wheels slip.", advice="Drive slower.")
    judged = Verdict(level=Level.REDO, headline="No.", reasons=(reason,), next_steps=("Drive slower.",))
    a, b = calibration(detail=PLAIN), calibration(detail=PLAIN, verdict=judged)
    text = comparison(a, b, difference(a, b))
    assert "B: REDO - No." in text
    assert "why: The wheels slip." in text
    assert "A: " not in text.split("\n\n")[-1]


@pytest.fixture
def files(tmp_path: Path) -> dict[str, str]:
    made = {
        "a": calibration(detail=PLAIN),
        "same": _moved(0.3 * SIGMA),
        "turned": _moved(np.where(np.arange(14) == 9, np.radians(0.3), 0.0)),
        "bare": calibration(),
        "other": calibration(robot=EVIL, detail=PLAIN),
        "large": calibration(image_size=(1280, 960), detail=PLAIN),
        "flat": calibration(wheels=Wheels(rR=0.0, rL=0.1, b=0.1), detail=PLAIN),
    }
    logged = replace(made["a"].provenance, inputs={"r01.mcap": "abc", "target": "t"})
    made["logged"] = replace(made["a"], provenance=logged)
    for name, c in made.items():
        save_calibration(c, tmp_path / f"{name}.json")
    whole = (tmp_path / "a.json").read_text()
    (tmp_path / "half.json").write_text(whole[: len(whole) // 2])
    (tmp_path / "newer.json").write_text(whole.replace('"schema": 1', '"schema": 99'))
    document = json.loads(whole)
    for name, value in (("broken", -1.0), ("skewed", 10.0), ("gaps", None)):
        document["covariance"]["matrix"][0][0 if name == "broken" else 1] = value
        document["covariance"]["matrix"][0 if name == "broken" else 1][0] = value
        (tmp_path / f"{name}.json").write_text(json.dumps(document))
        document = json.loads(whole)
    return {p.stem: str(p) for p in tmp_path.iterdir()} | {"missing": str(tmp_path / "missing.json")}


def test_exit_status_tells_same_from_different(files: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([files["a"], files["same"]]) == 0
    assert "no difference beyond chance" in capsys.readouterr().out
    assert main([files["a"], files["turned"]]) == 1
    out = capsys.readouterr().out
    assert "differ beyond chance" in out
    assert "largest, in sigmas: ry" in out
    assert "independent" in out
    assert main([files["a"], files["turned"], "--level", "1e-300"]) == 0


@pytest.mark.parametrize(
    ("a", "b", "says"),
    [
        ("a", "bare", "B came without a covariance: chance cannot be judged"),
        ("bare", "bare", "A and B came without a covariance"),
        ("logged", "logged", "the same log"),
        ("a", "other", "--any-robot"),
        ("large", "a", "images of 1280 x 960 and 640 x 480 px"),
        ("a", "half", "not a whole JSON file"),
        ("newer", "a", "schema 99, this version reads 1"),
        ("a", "missing", "cannot be read"),
        ("a", "broken", "variances that are not positive"),
        ("a", "skewed", "negative variance"),
        ("gaps", "a", "gaps"),
        ("a", "flat", "not a positive"),
    ],
)
def test_no_verdict_gets_one_clear_line(
    files: dict[str, str], capsys: pytest.CaptureFixture[str], a: str, b: str, says: str
) -> None:
    assert main([files[a], files[b]]) == 2
    said = capsys.readouterr()
    assert says in said.err
    assert said.err.count("\n") == 1
    assert ("B - A" in said.out) == ("chance cannot be judged" in said.err)


def test_other_names_are_compared_when_asked_to(files: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([files["other"], files["a"], "--any-robot"]) == 0
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.slow
def test_pairs_of_simulated_drives_keep_the_level_and_turned_cameras_are_found() -> None:
    """Of 12 pairs of the benchmark: chi-square as large as its degrees of freedom, and 0.3 deg always found."""
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "compare.py"
    spec = importlib.util.spec_from_file_location("benchmark_compare", path)
    assert spec is not None
    assert spec.loader is not None
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    pairs = [benchmark.pair(seed, 12) for seed in range(12)]
    same, turned = zip(*pairs, strict=True)
    ratio = np.mean([d.chi2 / d.dof for d in same])
    assert abs(ratio - 1) < 4 * np.sqrt(2 / 14 / 12)
    assert sum(d.p_value < 0.05 for d in same) <= 4  # more: 0.02 % by chance
    assert sum(d.p_value < 0.05 for d in turned) >= 12
