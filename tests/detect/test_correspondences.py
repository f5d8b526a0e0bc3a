"""Correspondences on disk: what was found while reading comes back; what old files lack is derived from the rest."""

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_logs import STEP, drive

from boxcal.calib.likelihood.estimator import step_of
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.detect.correspondences import Correspondences, StopObservation, load_correspondences
from boxcal.detect.errors import DetectError
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
            uv_px=np.stack([3.0 * (ids % 8), 5.0 * (ids % 3)], axis=1),
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


def _header_with(path: Path, change: Callable[[dict[str, Any]], None], **arrays: Any) -> Path:
    """Save a drive with something in its header, or an array, replaced."""
    _saw(_apart()).save(path)
    with np.load(path) as data:
        kept = {name: data[name] for name in data}
    header = json.loads(bytes(kept["header"]))
    change(header)
    kept["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez_compressed(path, **{**kept, **arrays})
    return path


def test_what_a_file_says_is_printed_without_control_characters(tmp_path: Path) -> None:
    def hostile(header: dict[str, Any]) -> None:
        header["robot"] = "r\x1b]0;x\x07"
        header["source"] |= {"notes": ["\x1b[31mred\nnext\u202e"], "camera_frame": "a\x1b[2J", "log": "b\rc.mcap"}
        header["source"]["losses"] = [{"kind": "recording-damaged", "text": "\x1b[2Jlost"}]

    found = load_correspondences(_header_with(tmp_path / "a.npz", hostile))
    assert found.robot == "r?]0;x?"
    assert found.source.notes == ("?[31mred next?",)
    assert (found.source.camera_frame, found.source.log) == ("a?[2J", "b c.mcap")
    assert [loss.text for loss in found.source.losses] == ["?[2Jlost"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda h: h.update(robot=[1]), "no name"),
        (lambda h: h.update(source=None), "source of None"),
        (lambda h: h["source"].update(log=3), "log of 3"),
        (lambda h: h["source"].update(nominal_radius="x"), "nominal_radius of 'x'"),
        (lambda h: h["source"].update(nominal_T_base_cam=[1.0]), "nominal_T_base_cam"),
        (lambda h: h["source"].update(print_sizes=[1.0]), "print_sizes"),
        (lambda h: h["source"].update(print_sizes=[1.0, 0.0, 1.0, 1.0]), "print_sizes"),
        (lambda h: h["source"].update(notes=[1]), "notes of 1"),
        (lambda h: h["stops"][0].update(phi_R=None), "no angle"),
        (lambda h: h["stops"][0].update(phi_L=1e300), "no angle"),
        (lambda h: h["stops"][0].update(t_start_ns="x"), "no whole number"),
        (lambda h: h["stops"][0].update(t_start_ns=2**62), "ends before it begins"),
        (lambda h: h["stops"][0].update(frames=-1), "negative"),
        (lambda h: h.update(image_size=[0, 48]), "images of"),
        (lambda h: h.update(image_size=[10**300, 48]), "images of"),
    ],
)
def test_values_in_a_file_that_cannot_be_are_refused_in_one_line(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    with pytest.raises(DetectError, match=words) as refused:
        load_correspondences(_header_with(tmp_path / "a.npz", change))
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 250


@pytest.mark.parametrize(
    ("name", "at", "value", "words"),
    [
        ("stop0_uv_px", (0, 0), 1e300, "far outside the picture"),
        ("stop0_uv_px", (0, 1), -49.0, "far outside the picture"),
        ("stop0_uv_px", ..., 20.0, "on one line"),
        ("stop0_uv_px", (slice(None), 1), 20.0, "on one line"),
        ("stop0_p_box", (0, 0), 1e300, "from the box"),
        ("stop0_cov_px2", (0, 0, 0), -1.0, "not positive"),
        ("stop0_cov_px2", (0, 0, 1), 2.0, "not positive"),
        ("stop0_landmark_ids", (0,), -8, "do not ascend"),
        ("stop0_landmark_ids", (1,), 8, "do not ascend"),
        ("phi_R", (5,), 1e300, "beyond"),
    ],
)
def test_arrays_in_a_file_that_cannot_be_are_refused(
    tmp_path: Path, name: str, at: Any, value: float, words: str
) -> None:
    saved = _header_with(tmp_path / "a.npz", lambda h: None)
    with np.load(saved) as data:
        array = data[name]
    array[at] = value
    with pytest.raises(DetectError, match=words):
        load_correspondences(_header_with(saved, lambda h: None, **{name: array}))


def test_an_array_that_claims_more_than_any_memory_is_refused(tmp_path: Path) -> None:
    saved = _header_with(tmp_path / "a.npz", lambda h: None)
    claimed = io.BytesIO()
    np.lib.format.write_array_header_1_0(claimed, {"descr": "<f8", "fortran_order": False, "shape": (10**14,)})
    with zipfile.ZipFile(saved) as old, zipfile.ZipFile(tmp_path / "b.npz", "w") as new:
        for name in old.namelist():
            new.writestr(name, claimed.getvalue() if name == "phi_R.npy" else old.read(name))
    with pytest.raises(DetectError, match=r"b\.npz: "):
        load_correspondences(tmp_path / "b.npz")
