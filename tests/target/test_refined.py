"""A box whose shape a fleet found: its landmarks, its file, and calibrations with it."""

import json
from pathlib import Path

import numpy as np
import pytest

from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.target_deformation import target_deformation
from boxcal.target.box import CORNERS, Box, Target, make_target
from boxcal.target.errors import TargetError
from boxcal.target.files.target_json import design_sha256, load_target, save_target, target_sha256
from boxcal.target.measure.cli import main
from boxcal.target.measure.measured_size import Measured
from boxcal.target.measure.refined_shape import SHAPE, RefinedShape

MEASURED = Measured(
    sx=0.998,
    sy=0.997,
    width=0.2504,
    depth=0.2498,
    height=0.2003,
    cov=np.diag(np.square([1e-3, 1e-3, 2e-4, 2e-4, 2e-4])),
)


def _refined(seed: int = 1) -> RefinedShape:
    rng = np.random.default_rng(seed)
    unit = np.array([1e-3 if name.startswith("scale") else 5e-3 if "_r" in name else 4e-4 for name in SHAPE])
    A = rng.standard_normal((len(SHAPE), len(SHAPE))) * 0.1 * unit[:, None]
    return RefinedShape(values=unit * rng.standard_normal(len(SHAPE)), cov=A @ A.T, robots=7, drives=("0f", "1e"))


def _landmarks(target: Target, described: Target, values: dict[str, float], **options: float) -> np.ndarray:
    """Return all landmarks as the likelihood has them for values of the shape's unknowns."""
    ids = (CORNERS * target.tag_ids[:, None] + np.arange(CORNERS)).ravel()
    found = target_deformation(EstimateOptions(target=described, **options), ids, described.p_box(ids))  # type: ignore[arg-type]
    return found.landmarks(np.array([values.get(name, 0.0) for name in found.names]))[0].reshape(-1, CORNERS, 3)


@pytest.mark.parametrize("measured", [None, MEASURED])
def test_a_refined_boxs_landmarks_are_those_of_the_likelihood(measured: Measured | None) -> None:
    refined = _refined()
    target, described = make_target(None, measured, refined), make_target(None, measured)
    values = dict(zip(SHAPE, refined.values.tolist(), strict=True))
    np.testing.assert_allclose(target.tag_corners, _landmarks(target, described, values), rtol=0, atol=1e-12)
    np.testing.assert_allclose(target.tag_corners, _landmarks(target, target, {}), rtol=0, atol=1e-12)
    # Departures from a refined box add to what was found before.
    more = {"scale_x": 2e-3, "bow2": 3e-4, "face1_tz": -2e-4, "face3_ry": 1e-3, "seat": 1e-4}
    both = {name: value + more.get(name, 0.0) for name, value in values.items()}
    there = _landmarks(target, target, more)
    np.testing.assert_allclose(there, _landmarks(target, described, both), rtol=0, atol=1e-12)
    taken_as_found = _landmarks(target, target, {}, scale_sigma=0.0, bow_sigma=0.0, ink_sigma=0.0)
    np.testing.assert_allclose(taken_as_found, target.tag_corners, rtol=0, atol=1e-12)


def test_the_likelihood_takes_a_refined_boxs_covariance_as_its_prior() -> None:
    refined = _refined()
    target = make_target(None, None, refined)
    ids = CORNERS * target.tag_ids
    found = target_deformation(EstimateOptions(target=target), ids, target.p_box(ids))
    at = [found.names.index(name) for name in SHAPE]
    sigma = np.sqrt(np.diag(refined.cov))
    cov = np.linalg.inv(found.information[np.ix_(at, at)] * np.outer(sigma, sigma))
    np.testing.assert_allclose(cov, refined.cov / np.outer(sigma, sigma), rtol=0, atol=1e-7)
    assert not np.any(np.isfinite(found.sigma[at]))
    assert set(found.component) == {""}


@pytest.mark.parametrize("measured", [None, MEASURED])
def test_a_refined_target_is_read_back_as_it_was_written(measured: Measured | None, tmp_path: Path) -> None:
    target = make_target(Box(), measured, _refined())
    save_target(target, tmp_path / "target.json")
    again = load_target(tmp_path / "target.json")
    assert again.refined is not None
    np.testing.assert_array_equal(again.refined.values, _refined().values)
    np.testing.assert_array_equal(again.refined.cov, _refined().cov)
    assert (again.refined.robots, again.refined.drives) == (7, ("0f", "1e"))
    assert target_sha256(again) == target_sha256(target) != target_sha256(target.unrefined)
    assert design_sha256(again) == design_sha256(make_target())
    assert len((tmp_path / "target.json").read_text().splitlines()) < 250  # a row of the covariance a line


def test_a_box_that_is_measured_loses_the_shape_that_was_found_of_it_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_target(make_target(None, None, _refined()), tmp_path / "target.json")
    assert main([str(tmp_path / "target.json"), "--tags-x", "237.5"]) == 0
    assert "fleet-calibrate --joint-box finds it anew" in capsys.readouterr().out
    assert load_target(tmp_path / "target.json").refined is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"cov": [[1.0]]}, "31 values and 31 rows of 31 numbers"),
        ({"values": [9.0] * 31}, "refined scale_x is 9, at most 0.2 is credible"),
        ({"values": ["a"] * 31}, "must be numbers"),
        ({"cov": (-np.eye(31)).tolist()}, "no covariance"),
        ({"robots": 0}, "refined.robots is 0"),
        ({"robots": True}, "refined.robots is True"),
        ({"drives": [1]}, "refined.drives must be a list of texts"),
        ({"order": ["scale_x"]}, "refined.order is not that of this version"),
        ({"more": 1}, "'refined' must hold order, values, robots, drives, cov"),
        ({"values": [1e-3] * 31}, "mm from where the file's own dimensions put them"),
    ],
)
def test_a_spoilt_refined_target_is_refused(change: dict[str, object], said: str, tmp_path: Path) -> None:
    path = tmp_path / "target.json"
    save_target(make_target(None, None, _refined()), path)
    document = json.loads(path.read_text())
    document["refined"] |= change
    path.write_text(json.dumps(document))
    with pytest.raises(TargetError, match=said):
        load_target(path)
