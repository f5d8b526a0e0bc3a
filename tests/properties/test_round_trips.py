"""What is saved comes back as it was: calibrations, targets and correspondences, whatever they hold."""

import string
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.results.build import closed_form, refined
from boxcal.calib.results.calibration import Calibration, Provenance
from boxcal.calib.results.json_format import calibration_document, load_calibration, save_calibration
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.correspondences import Correspondences, load_correspondences
from boxcal.detect.log.source import Source
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.box import Box, make_target
from boxcal.target.camera.camera_model import CameraKind, CameraModel
from boxcal.target.camera.distortion import DISTORTION_NAMES
from boxcal.target.errors import TargetError
from boxcal.target.files.target_json import load_target, save_target, target_bytes

# One folder serves all examples of a test: each writes its file anew.
one_folder = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
numbers = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
texts = st.text(max_size=30)
counts = st.integers(0, 10**6)
times_ns = st.integers(0, 2**63 - 1)
vectors = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)
motions = st.builds(lambda w, t: rigid(exp_so3(w), t), vectors, vectors)


@pytest.fixture(scope="module")
def drive() -> Correspondences:
    rng = np.random.default_rng(1)
    options = DriveOptions(stops=5, slip=3e-4, steps_per_sample=2)
    return exact_correspondences(
        khepera(), make_target(), simulate_drive(khepera(), make_target(), options, rng), 0.2, rng
    )


@pytest.fixture(scope="module")
def calibrations(drive: Correspondences) -> tuple[Calibration, Calibration]:
    """One of the closed form and one of the likelihood."""
    how, steps = Provenance(version="0", command="", created=""), solve_four_steps(drive)
    return (
        closed_form("r", [drive], [steps], how),
        refined("r", [drive], [steps], estimate([drive], steps), how),
    )


@st.composite
def cameras(draw: st.DrawFn) -> CameraModel:
    kind = draw(st.sampled_from(CameraKind))
    coefficients = {name: draw(st.floats(-1, 1)) for name in DISTORTION_NAMES[kind]}
    return CameraModel(
        kind=kind, fu=draw(positive), fv=draw(positive), cu=draw(numbers), cv=draw(numbers), **coefficients
    )


provenances = st.builds(
    Provenance,
    version=texts,
    command=texts,
    created=texts,
    inputs=st.dictionaries(texts, texts, max_size=3),
    settings=st.dictionaries(texts, st.one_of(st.none(), st.booleans(), numbers, texts), max_size=3),
)


@one_folder
@given(data=st.data(), likelihood=st.booleans())
def test_a_calibration_comes_back_as_it_was(
    tmp_path: Path,
    calibrations: tuple[Calibration, Calibration],
    data: st.DataObject,
    likelihood: bool,
) -> None:
    saved = calibrations[likelihood]
    if not likelihood:
        saved = replace(saved, camera=data.draw(cameras()))
    saved = replace(
        saved,
        robot=data.draw(texts),
        image_size=data.draw(st.tuples(st.integers(1, 9999), st.integers(1, 9999))),
        wheels=Wheels(rR=data.draw(positive), rL=data.draw(positive), b=data.draw(positive)),
        T_body_cam=data.draw(motions),
        stops=tuple(replace(stop, t_start_ns=data.draw(times_ns), landmarks=data.draw(counts)) for stop in saved.stops),
        provenance=data.draw(provenances),
        notes=tuple(data.draw(st.lists(texts))),
    )
    if saved.detail is not None:
        matrix = saved.detail.covariance.matrix.copy()
        for unknown in data.draw(st.sets(st.integers(0, 13))):  # infinite, NaN beside it: not determined
            matrix[unknown, :] = matrix[:, unknown] = np.nan
            matrix[unknown, unknown] = np.inf
        covariance = replace(saved.detail.covariance, matrix=matrix)
        saved = replace(saved, detail=replace(saved.detail, covariance=covariance))
    path = tmp_path / "calibration.json"
    save_calibration(saved, path)
    loaded = load_calibration(path)
    assert calibration_document(loaded) == calibration_document(saved)
    assert asdict(loaded.camera) == asdict(saved.camera)
    np.testing.assert_array_equal(loaded.T_body_cam, saved.T_body_cam)
    if saved.detail is not None:
        assert loaded.detail is not None
        np.testing.assert_array_equal(loaded.detail.covariance.matrix, saved.detail.covariance.matrix)


boxes = {
    "width": st.floats(0.05, 3),
    "depth": st.floats(0.05, 3),
    "height": st.floats(0.05, 3),
    "columns": st.integers(1, 5),
    "rows": st.integers(1, 5),
    "tag_size": st.floats(0.005, 0.3),
    "pitch": st.floats(0.006, 0.5),
    "first_id": st.integers(0, 400),
}


@one_folder
@given(figures=st.fixed_dictionaries(boxes))
def test_a_target_comes_back_from_its_file(tmp_path: Path, figures: dict[str, float]) -> None:
    try:
        box = Box(**figures)  # type: ignore[arg-type]
    except TargetError:  # figures that are no box: test_box.py has what is refused
        return
    target = make_target(box)
    save_target(target, tmp_path / "target.json")
    loaded = load_target(tmp_path / "target.json")
    assert loaded.box == box
    np.testing.assert_array_equal(loaded.tag_ids, target.tag_ids)
    np.testing.assert_array_equal(loaded.tag_faces, target.tag_faces)
    np.testing.assert_allclose(loaded.tag_corners, target.tag_corners, rtol=0, atol=1e-11)
    assert target_bytes(loaded) == target_bytes(target)


names = st.text(alphabet=string.ascii_letters + string.digits + string.punctuation + " äß機🤖", max_size=20)


@one_folder
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
def test_correspondences_come_back_from_their_file(
    tmp_path: Path, drive: Correspondences, data: st.DataObject, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    n = len(drive.wheels)
    covered = np.concatenate([[True], rng.random(n - 1) < 0.9])
    steps = data.draw(st.tuples(st.floats(0, 1), st.floats(0, 1)))
    wheels = WheelSamples(
        t_ns=drive.wheels.t_ns + data.draw(st.integers(-(10**17), 10**17)),
        phi_R=rng.normal(size=n) * 1e3, phi_L=rng.normal(size=n), encoder_steps=steps, covered=covered,
    )  # fmt: skip
    stops = []
    for stop in drive.stops[: data.draw(st.integers(0, 5))]:
        few = slice(0, int(rng.integers(0, len(stop.landmark_ids))))
        arrays = {name: getattr(stop, name)[few] for name in ("landmark_ids", "p_box", "faces", "uv_px", "cov_px2")}
        stops.append(replace(stop, **arrays, phi_R=float(rng.normal()), frames=data.draw(counts)))
    saved = Correspondences(
        robot=data.draw(names), image_size=data.draw(st.tuples(st.integers(640, 9999), st.integers(480, 9999))),
        wheels=wheels, stops=tuple(stops), source=Source(log=data.draw(names), sha256="ab"),
    )  # fmt: skip
    saved.save(tmp_path / "c.npz")
    loaded = load_correspondences(tmp_path / "c.npz")
    assert (loaded.robot, loaded.image_size, loaded.source) == (saved.robot, saved.image_size, saved.source)
    assert loaded.wheels.encoder_steps == wheels.encoder_steps
    for name in ("t_ns", "phi_R", "phi_L", "covered"):
        np.testing.assert_array_equal(getattr(loaded.wheels, name), getattr(wheels, name))
        assert getattr(loaded.wheels, name).dtype == getattr(wheels, name).dtype
    assert len(loaded.stops) == len(saved.stops)
    for a, b in zip(loaded.stops, saved.stops, strict=True):
        for name, value in asdict(b).items():
            np.testing.assert_array_equal(getattr(a, name), value)
