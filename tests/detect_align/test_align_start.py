"""An alignment under another response curve than the search's ends where further steps would take it."""

from dataclasses import replace

import numpy as np
import pytest
from aligned_views import PLAIN, TARGET, pose, view

from boxcal.detect.alignment import fine_alignment
from boxcal.detect.alignment.detector import detect_tags


@pytest.mark.parametrize("azimuth_deg", [28.0, 45.0])
def test_corners_under_srgb_lie_where_further_steps_would_take_them(azimuth_deg, monkeypatch):
    image = view(pose(azimuth_deg, distance=0.8), replace(PLAIN, srgb=True))
    stopped = detect_tags(image, TARGET)
    assert stopped.response == "srgb"
    monkeypatch.setattr(fine_alignment, "STOP_PX", 0.001)
    further = detect_tags(image, TARGET)
    np.testing.assert_array_equal(stopped.ids, further.ids)
    apart = np.linalg.norm(stopped.corners_px - further.corners_px, axis=2)
    apart /= np.sqrt(np.trace(further.cov_px2, axis1=2, axis2=3) / 2)
    assert np.sqrt(np.mean(apart**2)) < 0.12
