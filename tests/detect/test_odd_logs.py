"""Odd logs: none ends in a traceback, none is wrong without a word."""

import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from odd_logs import MOVE, PERIOD, STAND, STOPS, T0_NS, blank, odd_logs, sound, write
from small_logs import drive

from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.recording import Recording
from boxcal.detect.stops import find_stops

ODD = odd_logs()
_BAND = 0.02
"""Angles are right to this, rad: the coarsest encoders and the most noise of these logs apart."""
_READ_OTHERWISE = {
    "wheels swapped from stop 3 on": "told by the calibration, not by reading",
    "one wheel that never moves": "a robot may drive so; told by the calibration",
    "stamps since the start": "told by the clocks",
}


def test_there_are_over_two_hundred_kinds() -> None:
    assert len(ODD) >= 204


def _angles_are_right(found: Recording, tolerance: float) -> bool:
    """Tell whether the wheels' travel from stand to stand is the one that was driven, where it counts as known."""
    t_ns, phi_R, phi_L, _ = drive(stops=STOPS, stand=STAND, move=MOVE, step=0)
    wheels = found.wheels
    middles = T0_NS + np.round((np.arange(STOPS) * PERIOD + STAND / 2) * 1e9).astype(np.int64)
    read = np.array([np.min(np.abs(wheels.t_ns - t)) < 300_000_000 for t in middles])
    for k, (a, b) in enumerate(pairwise(middles)):
        if not (read[k] and read[k + 1]):
            continue
        inside = (wheels.t_ns > a) & (wheels.t_ns <= b)
        if not np.all(wheels.covered[inside]):
            continue
        for seen, true in ((wheels.phi_R, phi_R), (wheels.phi_L, phi_L)):
            travel = np.diff(np.interp(np.array([a, b]) - T0_NS, wheels.t_ns - T0_NS, seen))[0]
            if abs(travel - np.diff(np.interp([a - T0_NS, b - T0_NS], t_ns - T0_NS, true))[0]) > tolerance:
                return False
    return True


def _images_are_right(found: Recording) -> bool:
    """Tell whether each image that is shown at a stand was taken there."""
    for t, image in found.read_frames(range(found.frame_t_ns.size)):
        stop, within = divmod((t - T0_NS) / 1e9, PERIOD)
        if 0 <= stop < STOPS and within < STAND and image.shape == (48, 64):
            right = blank(48, 64) + np.uint8(10 * int(stop))
            if np.any(image) and np.max(np.abs(image.astype(int) - right.astype(int))) > 2:
                return False
    return True


@pytest.mark.parametrize("kind", ODD)
def test_an_odd_log_is_read_rightly_or_says_why_not(tmp_path: Path, kind: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        path = write(tmp_path / "a.mcap", ODD[kind]())
    try:
        found = open_recording(path)
        found.refuse_times_apart()
    except DetectError as error:
        assert str(error).startswith("a.mcap: ")  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
        return
    if kind in _READ_OTHERWISE:
        return
    tolerance = max(_BAND, 8e-3 * 4, 1.1 * max(found.wheels.encoder_steps))
    assert _angles_are_right(found, tolerance), found.notes
    assert _images_are_right(found) or any("clock" in n or "stamp" in n for n in found.notes), found.notes
    stops = find_stops(found.wheels)
    assert len(stops) >= STOPS - 1 or found.notes, (len(stops), found.notes)


def test_the_sound_log_has_all_its_stops_and_nothing_to_say(tmp_path: Path) -> None:
    found = open_recording(write(tmp_path / "a.mcap", sound()))
    assert not found.notes
    assert len(find_stops(found.wheels)) == STOPS
    assert _angles_are_right(found, 0.005)
    assert _images_are_right(found)
