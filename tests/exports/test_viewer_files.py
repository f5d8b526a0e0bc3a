"""What viewers are given: pictures of stops, Foxglove messages and Rerun recordings, read back."""

import base64
import importlib.util
import io
import json
import sys
from collections import defaultdict
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
import pytest
from made_up import EVIL, calibration, detail
from mcap.reader import make_reader

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.foxglove.results_mcap import results_mcap
from boxcal.calib.exports.rerun import rerun_recording
from boxcal.calib.exports.scene import Scene, make_scene, residual_colours
from boxcal.calib.exports.stop_images import draw_stops, paint_stop, stop_jpegs
from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.estimate import FlaggedCorner
from boxcal.calib.results.calibration import Calibration, StopResult
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import make_target
from boxcal.target.render.renderer import encode_jpeg, render

TARGET = make_target()
ROBOT = turtlebot(EVIL)
_KINDS = ("CameraCalibration", "CompressedImage", "FrameTransform", "ImageAnnotations", "SceneUpdate")
JPEG = cv2.imencode(".jpg", np.full((480, 640), 90, dtype=np.uint8))[1].tobytes()


def _drive() -> tuple[Drive, Correspondences]:
    driven = simulate_drive(ROBOT, TARGET, DriveOptions(stops=4, slip=0.0, encoder_step=0.0), np.random.default_rng(5))
    return driven, exact_correspondences(ROBOT, TARGET, driven)


DRIVEN, VIEWS = _drive()


def _true(**changes: Any) -> Calibration:
    stops = tuple(
        StopResult(
            t_start_ns=view.t_start_ns,
            t_end_ns=view.t_end_ns,
            landmarks=len(view.landmark_ids),
            reprojection_rms_px=0.0,
            T_box_cam=T,
        )
        for view, T in zip(VIEWS.stops, DRIVEN.T_box_cam, strict=True)
    )
    wheels = Wheels(rR=ROBOT.rR, rL=ROBOT.rL, b=ROBOT.b)
    made = calibration(robot=EVIL, camera=ROBOT.camera, wheels=wheels, T_body_cam=ROBOT.T_body_cam, stops=stops)
    return replace(made, **changes)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene(_true(), [VIEWS], TARGET)


def test_the_path_shown_is_the_path_driven(scene: Scene) -> None:
    assert len(scene.path) == 3
    for way in scene.path:
        true = DRIVEN.pose_at(way.t_ns)
        assert np.abs(way.poses[:, :2] - true[:, :2]).max() < 1e-6
        assert np.abs(np.sin((way.poses[:, 2] - true[:, 2]) / 2)).max() < 1e-6
        assert np.all(np.diff(way.t_ns) > 0)


def test_drives_of_one_robot_are_shown_together_and_not_connected() -> None:
    """Two drives that differ in time only: twice the stops and ways, none from one drive to the other."""
    one = _true()
    both = _true(stops=(*one.stops, *(replace(stop, drive=1) for stop in one.stops)))
    scene = make_scene(both, [VIEWS, VIEWS], TARGET)
    assert [stop.label for stop in scene.stops] == [f"{d}.{k}" for d in (1, 2) for k in (1, 2, 3, 4)]
    assert len(scene.path) == 6
    content = results_mcap(scene, {(1, 0): (VIEWS.stops[0].t_start_ns, JPEG)})
    assert sum(s is not None and s.name.endswith("CompressedImage") for s, _, _ in _messages(content)) == 1


def _messages(content: bytes) -> list[Any]:
    return list(make_reader(io.BytesIO(content)).iter_messages())


def test_colours_go_from_green_to_red_and_left_out_is_magenta() -> None:
    error = np.array([[0, 0], [0.5, 0], [0, -3.0], [np.nan, 0]])
    used = np.array([True, True, True, False])
    assert residual_colours(error, used).tolist() == [[0, 1, 0], [1, 1, 0], [1, 0, 0], [1, 0, 1]]


def test_pictures_show_corners_in_the_colour_of_their_residual() -> None:
    """A corner 3 px off is red, a flagged one magenta, all others green; the image is otherwise left as it is."""
    off = 8
    uv_px = VIEWS.stops[0].uv_px.copy()
    uv_px[off] += 3.0
    views = replace(VIEWS.stops[0], uv_px=uv_px)
    drive = replace(VIEWS, stops=(views, *VIEWS.stops[1:]))
    flagged = FlaggedCorner(drive=0, stop=0, landmark_id=int(views.landmark_ids[20]), error_px=(0.0, 0.0))
    made = _true(detail=replace(detail(), flagged_corners=(flagged,)))
    seen = make_scene(made, [drive], TARGET).stops[0]
    picture = paint_stop(np.full((480, 640), 90, dtype=np.uint8), "1", seen, views.uv_px)
    assert picture.shape == (2 * 480 + 24, 1280, 3)

    def colours_about(at: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        u, v = np.round((at + 0.5) * 2 - 0.5).astype(int)
        patch = picture[v - 6 : v + 7, u - 6 : u + 7].reshape(-1, 3).astype(int)
        return patch[np.ptp(patch, axis=1) > 100]

    red, magenta, green = (colours_about(views.uv_px[k]).mean(axis=0).argsort() for k in (off, 20, 60))
    assert red[-1] == 2
    assert set(magenta[-2:]) == {0, 2}
    assert green[-1] == 1
    assert np.all(picture[:150, :150] == 90)


def _log(path: Path, mirrored: bool) -> Path:
    """A log with a rendered image at every stop, mirrored if asked to."""
    shots = []
    for view, T in zip(VIEWS.stops, DRIVEN.T_box_cam, strict=True):
        image = render(TARGET, ROBOT.camera, inverse(T), ROBOT.image_size)
        shots.append(((view.t_start_ns + view.t_end_ns) // 2, encode_jpeg(image[:, ::-1] if mirrored else image)))
    with LogWriter(path) as log:
        for t, *phi in zip(DRIVEN.t_ns.tolist(), DRIVEN.phi_L, DRIVEN.phi_R, strict=True):
            log.joint_state("/joint_states", t, t, ("wheel_left_joint", "wheel_right_joint"), phi)
            while shots and shots[0][0] <= t:
                log.compressed_image("/camera/image/compressed", shots[0][0], t, shots.pop(0)[1])
    return path


def test_stops_are_drawn_with_and_without_a_calibration(tmp_path: Path) -> None:
    """A picture a stop; without a calibration the tags stand out, and mirrored ones are told in words."""
    log = _log(tmp_path / "r.mcap", mirrored=False)
    found = dict(draw_stops([log], TARGET, calibration=_true(), drives=[VIEWS]))
    assert list(found) == [f"stop-{k:02d}.jpg" for k in (1, 2, 3, 4)]
    assert _share(found["stop-01.jpg"], green=True) > 1e-3  # the corners, in green: no residual
    assert set(stop_jpegs([log], make_scene(_true(), [VIEWS], TARGET).stops)) == {(0, k) for k in range(4)}
    bare = dict(draw_stops([log], TARGET))
    assert list(bare) == list(found)
    assert _share(bare["stop-01.jpg"]) > 1e-3  # outlines in cyan
    mirror = dict(islice(draw_stops([_log(tmp_path / "m.mcap", mirrored=True)], TARGET), 1))
    assert _share(mirror["stop-01.jpg"]) < 1e-4
    words = [cv2.imdecode(np.frombuffer(b["stop-01.jpg"], np.uint8), 0)[-24:] for b in (bare, mirror)]
    assert (words[1] > 128).sum() > 1.3 * (words[0] > 128).sum()  # it says more: MIRRORED, print them again


def _share(content: bytes, *, green: bool = False) -> float:
    """Share of an image that is cyan, or green."""
    blue, greens, red = np.moveaxis(cv2.imdecode(np.frombuffer(content, np.uint8), 1).astype(int), -1, 0)
    return float(np.mean((greens > 150) & (red < 110) & ((blue < 110) if green else (blue > 150))))


def test_saved_correspondences_hold_no_images(tmp_path: Path) -> None:
    with pytest.raises(CalibError, match=r"c\.npz: holds no images"):
        next(draw_stops([tmp_path / "c.npz"], TARGET))
    assert stop_jpegs([tmp_path / "c.npz"], ()) == {}


def test_foxglove_messages_validate_and_read_back(scene: Scene) -> None:
    """Every message fits its schema; transforms, corners and images are the scene's."""
    t0 = VIEWS.stops[0].t_start_ns + 5
    content = results_mcap(scene, {(0, 0): (t0, JPEG)})
    read = defaultdict(list)
    for schema, channel, message in make_reader(io.BytesIO(content)).iter_messages():
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        value = json.loads(message.data)
        jsonschema.validate(value, json.loads(schema.data))
        read[schema.name].append((message.log_time, value))
    assert set(read) == {f"foxglove.{n}" for n in _KINDS}

    images = read["foxglove.CompressedImage"]
    assert [(t, base64.b64decode(i["data"])) for t, i in images] == [(t0, JPEG)]
    assert images[0][1]["timestamp"] == {"sec": t0 // 10**9, "nsec": t0 % 10**9}

    poses = {(f["parent_frame_id"], f["child_frame_id"], t): f for t, f in read["foxglove.FrameTransform"]}
    for stop, true in zip(VIEWS.stops, DRIVEN.stop_poses, strict=True):
        at = poses["box", "base_footprint", stop.t_end_ns]
        x, y, heading = true
        np.testing.assert_allclose([at["translation"][k] for k in "xyz"], [x, y, 0], atol=1e-9)
        q = at["rotation"]
        assert np.sin((2 * np.arctan2(q["z"], q["w"]) - heading) / 2) == pytest.approx(0, abs=1e-9)
    (mounted,) = [f for (parent, _, _), f in poses.items() if parent == "base_footprint"]
    np.testing.assert_allclose([mounted["translation"][k] for k in "xyz"], ROBOT.T_body_cam[:3, 3], atol=1e-12)

    notes = [a for _, a in read["foxglove.ImageAnnotations"]]
    assert len(notes) == 4
    points = [[p["x"], p["y"]] for p in notes[1]["points"][0]["points"]]
    np.testing.assert_allclose(points, VIEWS.stops[1].uv_px + 0.5, atol=1e-9)  # Foxglove counts from the pixel's corner
    (update,) = [u for _, u in read["foxglove.SceneUpdate"]]
    assert [e["id"] for e in update["entities"]] == ["box", "path", "stops"]
    assert b"<script>" not in content


def test_results_of_a_drive_without_images_or_stops_are_written_too() -> None:
    for stops in ((), _true().stops[:1]):
        made = make_scene(_true(stops=stops), [VIEWS], TARGET)
        assert list(make_reader(io.BytesIO(results_mcap(made, {}))).iter_messages())


@pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="the extra rerun is not installed")
def test_rerun_recordings_read_back(scene: Scene, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader  # noqa: PLC0415

    path = tmp_path / "drive.rrd"
    path.write_bytes(rerun_recording(scene, {(0, 0): (VIEWS.stops[0].t_start_ns, JPEG)}))
    chunks = {c.entity_path: c for c in RrdReader(path).stream()}
    assert chunks["/box/body/camera/image/picture"].num_rows == 1
    assert chunks["/box/body/camera/image/corners"].num_rows == len(VIEWS.stops)
    body = chunks["/box/body"].to_record_batch()
    times = body.column(body.schema.names.index("log")).cast("int64").to_pylist()
    assert set(times) >= {s.t_end_ns for s in VIEWS.stops}
    where = body.column(body.schema.names.index("Transform3D:translation")).to_pylist()
    shown = np.array([where[times.index(s.t_end_ns)][0] for s in VIEWS.stops])
    np.testing.assert_allclose(shown[:, :2], DRIVEN.stop_poses[:, :2], atol=1e-6)


def test_a_missing_rerun_says_how_to_get_it(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(CalibError, match="the rerun package is not installed; pip install"):
        rerun_recording(scene, {})
