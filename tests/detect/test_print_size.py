"""Prints of another size than described: tags that do not fit are counted, and the size that explains them is found."""

from pathlib import Path

import numpy as np
import pytest
from drive_session import session
from robot_logs import images, joints, write_mcap
from small_logs import LEFT, RIGHT
from small_views import TARGET, view

from boxcal.detect.extract import extract
from boxcal.detect.tags.box_at_stops import BoxAtStops
from boxcal.detect.tags.detections import TagSettings
from boxcal.detect.tags.print_size import print_scale, scaled_prints
from boxcal.detect.tags.stop_measurement import measure_stop

CORNER = 40.0
"""Azimuth of a camera that sees two faces, deg."""


@pytest.mark.parametrize("scale", [0.85, 0.92, 1.09])
def test_prints_of_another_size_are_found(scale: float) -> None:
    picture = view(CORNER, target=scaled_prints(TARGET, scale))
    assert print_scale(picture, TARGET, TagSettings()) == pytest.approx(scale, abs=0.021)


def test_tags_that_are_read_but_do_not_fit_the_box_are_counted() -> None:
    as_described, small = view(CORNER), view(CORNER, target=scaled_prints(TARGET, 0.9))
    assert measure_stop([as_described], TARGET).rejected_ids.size == 0
    found = measure_stop([small], TARGET)
    assert found.rejected_ids.size >= 10
    assert not np.isin(found.rejected_ids, found.corners.landmark_ids // 4).any()
    assert print_scale(as_described, TARGET, TagSettings()) == 1.0


def test_a_size_under_which_fewer_tags_are_found_at_the_stops_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_mcap(
        tmp_path / "a.mcap",
        joints("/joint_states", session().angles, [LEFT, RIGHT]),
        images(session().pictures),
    )
    right = extract(path, TARGET)
    monkeypatch.setattr(BoxAtStops, "print_scale", lambda _: 0.85)
    found = extract(path, TARGET)
    for stop, other in zip(found.stops, right.stops, strict=True):
        np.testing.assert_array_equal(stop.uv_px, other.uv_px)


def test_scaled_prints_stay_in_the_middle_of_their_faces() -> None:
    small = scaled_prints(TARGET, 0.9)
    for face in range(4):
        on = TARGET.tag_faces == face
        np.testing.assert_allclose(
            small.tag_corners[on].mean(axis=(0, 1)), TARGET.tag_corners[on].mean(axis=(0, 1)), atol=1e-12
        )
    side = np.linalg.norm(small.tag_corners[:, 1] - small.tag_corners[:, 0], axis=1)
    np.testing.assert_allclose(side, 0.9 * TARGET.box.tag_size, rtol=1e-12)
