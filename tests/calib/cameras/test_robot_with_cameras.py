from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import boxcal
from boxcal.calib.assessment.drive_rules import DRIVE_RULES
from boxcal.calib.compare.cameras import further
from boxcal.calib.compare.difference import difference
from boxcal.calib.compare.text import comparison
from boxcal.calib.console.cameras import cameras_table
from boxcal.calib.diagnosis.cameras import one_place, swapped
from boxcal.calib.geometry.camera_pair import between
from boxcal.calib.one_robot import several_cameras
from boxcal.calib.one_robot.camera_names import camera_names
from boxcal.calib.one_robot.judging import judged
from boxcal.calib.report.robot import robot_report
from boxcal.calib.results.json_format import calibration_document
from boxcal.calib.results.verdict import Level, Reason
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.several_cameras import chosen
from boxcal.target.errors import BoxcalError
from tests.calib.cameras.conftest import Rigged


def views(rig: Rigged, *names: str) -> dict[str, Correspondences]:
    """What each camera saw, as extracted from its topic; corners are as good as they say."""
    return {
        name: replace(view, source=replace(view.source, log="r.mcap", camera_topic=f"/{name}/image_raw"))
        for name, view in zip(names, rig.views, strict=True)
    }


def described(drive: Correspondences, T: np.ndarray) -> Correspondences:
    return replace(drive, source=replace(drive.source, nominal_T_base_cam=tuple(float(v) for v in T.ravel())))


def causes(found: boxcal.Calibration) -> set[str]:
    return {finding.cause for finding in found.findings}


@pytest.fixture(scope="module")
def calibrated(front_and_rear: Rigged) -> dict[str, boxcal.Calibration]:
    return boxcal.calibrate_cameras(views(front_and_rear, "front", "rear"))


def test_each_camera_has_its_own_lens_and_place_and_all_have_the_same_wheels(
    calibrated: dict[str, boxcal.Calibration], front_and_rear: Rigged
) -> None:
    assert list(calibrated) == ["front", "rear"]
    for found, robot in zip(calibrated.values(), front_and_rear.robots, strict=True):
        assert abs(found.camera.fu / robot.camera.fu - 1) < 2e-3
        assert np.allclose(found.T_body_cam, robot.T_body_cam, atol=4e-3)
    assert all(a.wheels == b.wheels for a, b in pairwise(calibrated.values()))
    assert [found.robot for found in calibrated.values()] == ["turtlebot", "turtlebot/rear"]


def test_transform_of_the_pair_holds_the_truth_within_its_sigmas(
    calibrated: dict[str, boxcal.Calibration], front_and_rear: Rigged
) -> None:
    rig = calibrated["front"].rig
    assert rig is not None
    assert not rig.apart
    pair = rig.pair("front", "rear")
    true = between(*(robot.T_body_cam for robot in front_and_rear.robots))
    sigma = np.array([pair.sigma[name] for name in ("tx", "ty", "tz")])
    assert np.all(np.abs(pair.T_a_b[:3, 3] - true[:3, 3]) < 4 * sigma)
    back = rig.pair("rear", "front")
    assert np.allclose(pair.T_a_b @ back.T_a_b, np.eye(4), atol=1e-12)
    assert np.trace(back.covariance) > 0


def test_rig_reads_back_from_calibration_json(calibrated: dict[str, boxcal.Calibration], tmp_path) -> None:
    boxcal.save_calibration(calibrated["front"], tmp_path / "calibration.json")
    rig, back = calibrated["front"].rig, boxcal.load_calibration(tmp_path / "calibration.json").rig
    assert rig is not None
    assert back is not None
    assert back.names == rig.names
    for a, b in zip(rig.cameras, back.cameras, strict=True):
        assert (a.topic, a.image_size, a.stops, a.camera) == (b.topic, b.image_size, b.stops, b.camera)
        assert np.array_equal(a.T_body_cam, b.T_body_cam)
    assert np.allclose(back.covariance, rig.covariance, rtol=1e-12)


def test_one_camera_keeps_its_format(calibrated: dict[str, boxcal.Calibration]) -> None:
    with_rig, alone = (
        calibration_document(replace(calibrated["front"], rig=rig)) for rig in (calibrated["front"].rig, None)
    )
    more = {"cameras", "camera_pairs", "cameras_covariance", "cameras_left_out", "cameras_apart", "cameras_stops"}
    assert with_rig.keys() - alone.keys() == more


def test_stops_of_all_cameras_count_for_the_verdict_on_the_wheels(calibrated: dict[str, boxcal.Calibration]) -> None:
    found = calibrated["front"]
    assert found.rig is not None
    assert found.rig.stops == 12
    assert len(found.stops) == 6

    def reason(c: boxcal.Calibration) -> Reason:
        return next(r for rule in DRIVE_RULES for r in rule(c) if r.rule == "stops")

    assert (reason(found).level, reason(found).text) == (Level.GOOD, "12 stops were used, 6 of them by this camera.")
    assert reason(replace(found, rig=None)).level is Level.USABLE
    few = replace(found, stops=found.stops[:4])
    assert reason(few).level is Level.REDO
    assert "Only 4 stops" in reason(few).text


def test_second_topic_of_one_camera_is_recognised(stereo: Rigged) -> None:
    seen = views(stereo, "left", "right")
    again = replace(seen["left"], source=replace(seen["left"].source, camera_topic="/left/processed"))
    found = boxcal.calibrate_cameras({"left": seen["left"], "again": again})
    assert list(found) == ["left"]
    assert any("shows the camera of /left/image_raw once more" in note for note in found["left"].notes)
    assert one_place(stereo.fits[0], stereo.fits[0], [[seen["left"]]] * 2)
    assert not one_place(stereo.fits[0], stereo.fits[1], [[seen["left"]], [seen["right"]]])


def test_camera_that_was_asked_for_and_sees_too_little_is_said_and_never_good(front_and_rear: Rigged) -> None:
    seen = views(front_and_rear, "front", "rear")
    short = replace(seen["rear"], stops=seen["rear"].stops[:2])
    asked = boxcal.calibrate_cameras(
        {"front": seen["front"], "rear": short}, cameras=("/front/image_raw", "/rear/image_raw")
    )
    assert list(asked) == ["front"]
    assert "camera-missing" in causes(asked["front"])
    assert asked["front"].verdict.level != "good"
    with pytest.raises(BoxcalError, match="usable stops"):
        boxcal.calibrate_cameras({"rear": short})


def test_cameras_swapped_against_the_description_are_said(front_and_rear: Rigged) -> None:
    seen, (front, rear) = views(front_and_rear, "front", "rear"), (r.T_body_cam for r in front_and_rear.robots)
    assert swapped([front, rear], [front.ravel(), rear.ravel()]) is None
    assert swapped([front, rear], [rear.ravel(), ()]) is None
    wrong = {"front": described(seen["front"], rear), "rear": described(seen["rear"], front)}
    found = boxcal.calibrate_cameras(wrong)["front"]
    assert "cameras-swapped" in causes(found)
    assert "camera-direction" not in causes(found)  # the same once more, and another cause for it
    assert found.verdict.level != "good"


def test_report_and_comparison_know_the_cameras(
    calibrated: dict[str, boxcal.Calibration], front_and_rear: Rigged
) -> None:
    page = robot_report(calibrated["rear"], front_and_rear.views[1], boxcal.make_target()).decode()
    assert "From camera to camera" in page
    assert 'href="../report.html"' in page
    one = calibrated["front"]
    same = comparison(one, one, difference(one, one), further(one, one))
    assert "camera rear against front: moved by 0.00 mm, turned by 0.000 deg" in same
    assert "front" in cameras_table([calibrated["front"]])
    assert not cameras_table([replace(calibrated["front"], rig=None)])


@pytest.mark.parametrize("of_robot", [False, True])
def test_another_camera_that_must_not_be_used_keeps_the_robot_from_good(
    of_robot: bool, front_and_rear: Rigged, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is the camera's fault unless the robot's own verdict says the same."""
    reason = Reason(rule="position", level=Level.REDO, text="After 10 m the position is off by 2 m.")

    def strict(result: boxcal.Calibration, *rest: object) -> boxcal.Calibration:
        found = judged(result, *rest)
        assert found.verdict is not None
        if not of_robot and "/" not in result.robot:
            return found
        reasons = (reason, *found.verdict.reasons)
        return replace(found, verdict=replace(found.verdict, level=Level.REDO, reasons=reasons))

    monkeypatch.setattr(several_cameras, "judged", strict)
    found = boxcal.calibrate_cameras(views(front_and_rear, "front", "rear"))["front"]
    assert ("camera-unusable" in causes(found)) != of_robot
    assert found.verdict is not None
    assert found.verdict.level != "good"
    assert found.rig is not None
    assert [camera.verdict for camera in found.rig.cameras] == [str(found.verdict.level), "redo"]
    assert reason.text in found.rig.cameras[1].why


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (("/front/image_raw/compressed", "/rear/image_raw"), ("front", "rear")),
        (("/camera/color/image_raw", "/camera/infra1/image_rect_raw"), ("camera_color", "camera_infra1")),
        (("/image_raw", "/../etc/x", "/1/image"), ("image_raw", "etc_x", "camera_1")),
        (("/a-b/image", "/a_b/image"), ("a_b", "a_b_2")),
    ],
)
def test_cameras_are_named_by_their_topics(topics: tuple[str, ...], names: tuple[str, ...]) -> None:
    assert camera_names(topics) == names


def test_depth_other_transports_and_derived_pictures_are_no_cameras() -> None:
    counts = {
        "/c/color/image_raw": 9,
        "/c/color/image_raw/compressed": 9,
        "/c/color/image_rect": 9,
        "/c/depth/image_raw": 9,
        "/c/infra1/image_rect_raw": 9,
        "/c/infra2/image_rect_raw": 0,
        "/c/z16": 9,
    }
    found = chosen(counts, {"/c/z16"})
    assert found.cameras == ("/c/color/image_raw", "/c/infra1/image_rect_raw")
    assert set(found.left_out) == set(counts) - set(found.cameras)
