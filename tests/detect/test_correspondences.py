"""Correspondences on disk: what was found while reading comes back; what old files lack is derived from the rest."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_logs import STEP, drive

from boxcal.calib.likelihood.estimator import step_of
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.detect.correspondences import Correspondences, StopObservation, load_correspondences
from boxcal.detect.log.encoder import clean, join
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.tags.faces import faces_by_normal
from boxcal.target.box import make_target

TARGET = make_target()


def _apart() -> WheelSamples:
    """Each wheel with stamps of its own, so that the joined angles are interpolated."""
    t_ns, phi_R, phi_L, _ = drive(stops=6)
    late = t_ns + 7_000_000 + np.random.default_rng(0).integers(-300_000, 300_000, len(t_ns))
    return join(clean(t_ns, phi_R, "right"), clean(late, phi_L, "left"), "log")


def _saw(wheels: WheelSamples) -> Correspondences:
    def stop(first: int) -> StopObservation:
        ids = np.array([8, 9, 10, 11, 400, 401, 402, 403], dtype=np.int64)[: 4 if first else 8]
        return StopObservation(
            t_start_ns=int(wheels.t_ns[first]),
            t_end_ns=int(wheels.t_ns[first + 9]),
            first_sample=first,
            last_sample=first + 9,
            phi_R=float(wheels.phi_R[first]),
            phi_L=float(wheels.phi_L[first]),
            landmark_ids=ids,
            p_box=TARGET.p_box(ids),
            faces=TARGET.faces(ids),
            uv_px=np.zeros((len(ids), 2)),
            cov_px2=np.tile(np.eye(2), (len(ids), 1, 1)),
            frames=1,
        )

    return Correspondences(robot="r", image_size=(64, 48), wheels=wheels, stops=tuple(stop(f) for f in (0, 150, 300)))


def test_encoder_steps_found_while_reading_are_those_saved_where_each_wheel_has_its_own_stamps(tmp_path: Path) -> None:
    wheels = _apart()
    assert wheels.encoder_steps == pytest.approx((STEP, STEP), rel=1e-9)
    _saw(wheels).save(tmp_path / "a.npz")
    assert load_correspondences(tmp_path / "a.npz").wheels.encoder_steps == wheels.encoder_steps


def test_the_estimator_takes_the_step_that_was_found_while_reading() -> None:
    assert step_of([_saw(_apart())], EstimateOptions()) == pytest.approx(STEP, rel=1e-9)


def test_legs_without_a_known_travel_are_named_and_saved(tmp_path: Path) -> None:
    wheels = _apart()
    covered = np.ones(len(wheels), dtype=np.bool_)
    covered[200] = False
    drive = _saw(replace(wheels, covered=covered))
    assert drive.legs_covered.tolist() == [True, False]
    drive.save(tmp_path / "a.npz")
    assert load_correspondences(tmp_path / "a.npz").legs_covered.tolist() == [True, False]


def test_a_file_of_the_first_versions_loads_with_steps_faces_and_coverage_told_from_the_rest(tmp_path: Path) -> None:
    t_ns, phi_R, phi_L, _ = drive(stops=6)
    _saw(WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L)).save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as data:
        arrays = {k: data[k] for k in data if not k.endswith(("covered", "faces"))}
    header = json.loads(bytes(arrays["header"]))
    del header["encoder_steps"]
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    (tmp_path / "old.npz").write_bytes(buffer.getvalue())
    old = load_correspondences(tmp_path / "old.npz")
    assert old.wheels.encoder_steps == pytest.approx((STEP, STEP), rel=1e-9)
    np.testing.assert_array_equal(old.stops[0].faces, TARGET.faces(old.stops[0].landmark_ids))
    assert old.legs_covered.tolist() == [True, True]


def test_faces_are_told_from_the_normals_of_all_tags_and_partly_seen_ones_from_their_place() -> None:
    ids = (4 * TARGET.tag_ids[:, None] + np.arange(4)).ravel()
    np.testing.assert_array_equal(faces_by_normal(ids, TARGET.p_box(ids)), np.repeat(TARGET.tag_faces, 4))
    some = np.delete(ids, [1, 2, 81, 83])
    np.testing.assert_array_equal(faces_by_normal(some, TARGET.p_box(some)), TARGET.faces(some))
