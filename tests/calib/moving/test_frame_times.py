"""When frames were taken, each by itself: told as solving with that unknown tells it; causes of lateness compared."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import boxcal
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.moving.clock import one_time
from boxcal.calib.likelihood.moving.faults import sound
from boxcal.calib.likelihood.moving.frame_times import FrameTimes, frame_times, gains
from boxcal.calib.likelihood.moving.jumps import clearest_step
from boxcal.calib.likelihood.moving.levels import settled
from boxcal.calib.likelihood.moving.noise import FrameNoise
from boxcal.calib.likelihood.moving.solve import joined
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.moving_frames import ShutterOptions, moving_frames
from boxcal.detect.correspondences import Correspondences

NOISE = FrameNoise(slip=3e-4, jitter_s=1e-3, sway=1.0, scale=1.0)


@cache
def _stops() -> tuple[Correspondences, Fit]:
    simulated = boxcal.simulate(options=DriveOptions(stops=12, slip=3e-4), seed=11)
    rng = np.random.default_rng(2)
    frames = moving_frames(simulated.robot, simulated.target, simulated.drive, ShutterOptions(), rng)[::2]
    options = EstimateOptions(target=simulated.target, systematic_share=0.0)
    drive = replace(simulated.correspondences, moving=frames)
    return drive, fit([drive], None, options)


def _later(later_ms: dict[int, float]) -> Correspondences:
    """The drive with some frames stamped later."""
    drive = _stops()[0]
    return replace(
        drive,
        moving=tuple(
            replace(frame, t_ns=frame.t_ns + round(1e6 * later_ms.get(k, 0.0))) for k, frame in enumerate(drive.moving)
        ),
    )


def _times(later_ms: dict[int, float]) -> tuple[FrameTimes, list[int]]:
    """When frames were taken, and their numbers."""
    drive, solved = _later(later_ms), _stops()[1]
    found = settled(solved, [drive], joined(solved, [drive], np.arange(len(drive.moving)), one_time(1), NOISE), NOISE)
    assert found is not None
    there = found.joint.woven
    return frame_times(solved, found), there.frame[there.moving].tolist()


def test_each_frame_tells_its_own_lateness_whatever_the_others_say() -> None:
    later = {4: 3.0, 11: -2.0}
    (right, frames), (off, same) = _times({}), _times(later)
    assert same == frames
    assert set(later) <= set(frames)
    for k, frame in enumerate(frames):
        change = off.late_s[k] - right.late_s[k]
        assert abs(change - 1e-3 * later.get(frame, 0.0)) < 3e-4 + 0.5 * np.sqrt(right.cov[k, k])
    z = right.late_s / np.sqrt(np.diag(right.cov))
    assert np.sqrt(np.mean(z**2)) < 1.6
    np.testing.assert_allclose(right.cov, right.cov.T, rtol=0, atol=1e-6 * np.abs(right.cov).max())


def _made_up(late_s: np.ndarray, sigma_s: float = 2e-4) -> FrameTimes:
    count = len(late_s)
    return FrameTimes(
        places=2 * np.arange(count),
        late_s=late_s,
        cov=sigma_s**2 * (np.eye(count) + 0.2),
        since_s=np.linspace(-50, 50, count),
        drive=np.zeros(count, dtype=np.int64),
    )


def test_gains_are_those_of_the_likelihood_at_its_most_probable_jitter() -> None:
    rng = np.random.default_rng(3)
    times = _made_up(1e-3 * rng.standard_normal(14))
    cause = (np.arange(14) >= 6).astype(float)
    gain, size = gains(times, times.lines, cause[:, None])

    def best(X: np.ndarray) -> tuple[float, float]:
        found = []
        for jitter in np.geomspace(1e-5, 0.1, 4000):
            C = times.cov + jitter**2 * np.eye(14)
            W = np.linalg.inv(C)
            b = np.linalg.solve(X.T @ W @ X, X.T @ W @ times.late_s)
            r = times.late_s - X @ b
            found.append((float(-np.linalg.slogdet(C)[1] - r @ W @ r), float(b[-1])))
        return max(found)

    without, (more, height) = best(times.lines), best(np.column_stack([times.lines, cause]))
    assert gain[0] == pytest.approx((14 - 3) / 14 * (more - without[0]), abs=0.1)
    assert size[0] == pytest.approx(height, rel=0.03)


@pytest.mark.parametrize("step_ms", [-30.0, 3.0])
def test_a_step_is_told_from_jitter_and_from_one_frame_of_another_time(step_ms: float) -> None:
    rng = np.random.default_rng(5)
    scatter = 3e-4 * rng.standard_normal(16)
    step = clearest_step(_made_up(scatter + 1e-3 * step_ms * (np.arange(16) >= 9)))
    assert step is not None
    assert step.place == 18
    assert step.later_s == pytest.approx(1e-3 * step_ms, abs=1e-3)
    alone = scatter.copy()
    alone[8] += 1e-3 * step_ms
    assert clearest_step(_made_up(alone)) is None


def test_jitter_is_seldom_taken_for_a_jump() -> None:
    rng = np.random.default_rng(6)
    found = [clearest_step(_made_up(s * rng.standard_normal(n))) for s in (0.0, 2e-3, 1e-2) for n in [12, 20, 40] * 60]
    assert sum(step is not None for step in found) <= 4


@pytest.mark.parametrize("odd", [(5,), (5, 6), (2, 7, 12)])
def test_frames_of_another_time_are_left_out_and_no_good_one_with_them(odd: tuple[int, ...]) -> None:
    solved = _stops()[1]
    drives = [_later({}), _later(dict(zip(odd, (60.0, -45.0, 25.0), strict=False)))]
    found = [sound(solved, [drive], np.arange(len(drive.moving)), NOISE) for drive in drives]
    used = []
    for one in found:
        assert one.settled is not None
        assert one.jumps == ()
        used.append(set(one.settled.joint.woven.frame[one.settled.joint.woven.moving].tolist()))
    assert found[0].odd == 0
    assert set(odd) <= used[0]
    assert used[1] == used[0] - set(odd)
