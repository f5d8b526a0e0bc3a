"""Frames on the move as a good detector would measure them: clocks, jitter, exposure and rolling shutter."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.as_built import as_built
from boxcal.calib.simulate.drive import Drive
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.viewpoints import decodable_tags
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, Target
from boxcal.target.camera.camera_model import project

_EXPOSURE_SAMPLES, _ROW_ROUNDS = 5, 3
_ALONG = 0.05
"""Fraction of a streak's length that corners err by along it, beyond their noise."""
_LENS_PX, _BLUR_ERROR = 0.6, 0.1
"""Standard deviation of the blur of lens and pixels, and the fraction of its own that the variance of a streak errs
by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutterOptions:
    """Clock and shutter of a simulated camera, and the noise of its corners.

    Attributes
    ----------
    late_s : s
        Stamp less the middle of the exposure, in the middle of the frames.
    clock_rate : s/s
        How much later frames are stamped for each second that passes.
    clock_jump_s : s
        How much later they are stamped from the middle on.
    jitter_s : s
        Standard deviation of each frame's own error in time.
    exposure_s : s
        How long the shutter is open.
    readout_s : s
        From the first row to the last; the middle row is seen at the frame's time.
    sigma_px : px
        Standard deviation of the noise on each pixel coordinate, which the covariance states.
    period_s : s
        Between frames.
    """

    late_s: float = 0.0
    clock_rate: float = 0.0
    clock_jump_s: float = 0.0
    jitter_s: float = 0.0
    exposure_s: float = 0.0
    readout_s: float = 0.0
    sigma_px: float = 0.1
    period_s: float = 0.25


def moving_frames(
    robot: Robot, target: Target, drive: Drive, options: ShutterOptions, rng: np.random.Generator
) -> tuple[MovingFrame, ...]:
    """Return all frames of a drive that were taken between stops and show two tags or more.

    Parameters
    ----------
    robot, target, drive
        Who drove around what, and the drive.
    options
        The camera's clock and shutter.
    rng
        Draws noise and jitter.
    """
    begun, ended = drive.stop_t_ns[1:, 0], drive.stop_t_ns[:-1, 1]
    t_ns = np.arange(ended[0], begun[-1], round(options.period_s * 1e9))
    t_ns = t_ns[[bool(np.any((t > ended) & (t < begun))) for t in t_ns]]
    since_s = (t_ns - (t_ns[0] + t_ns[-1]) // 2) / 1e9
    late_s = options.late_s + options.clock_rate * since_s + options.clock_jump_s * (since_s > 0)
    stamps = t_ns + np.rint(1e9 * (late_s + options.jitter_s * rng.standard_normal(len(t_ns)))).astype(np.int64)
    order = np.argsort(stamps, kind="stable")
    targets = (target, as_built(target, drive.faults.box))
    frames = [_frame(robot, targets, drive, options, rng, (int(t_ns[k]), int(stamps[k]))) for k in order]
    return tuple(frame for frame in frames if frame is not None)


def _frame(  # noqa: PLR0917 - a robot, its drive and its camera
    robot: Robot,
    targets: tuple[Target, Target],
    drive: Drive,
    options: ShutterOptions,
    rng: np.random.Generator,
    times: tuple[int, int],
) -> MovingFrame | None:
    """Return the frame taken at a true time and stamped at another, ns; None if it shows fewer than two tags.

    ``targets`` are the box as described and as built.
    """
    (t_ns, stamp), (target, built) = times, targets
    stop = drive.stop_at(t_ns)
    T_box_cam = drive.T_box_cam_at(np.array([t_ns]), stop)[0]
    tags = decodable_tags(replace(robot, camera=drive.scene.cameras[stop]), built, T_box_cam)
    if len(tags) < 2:
        return None
    ids = (CORNERS * tags[:, None] + np.arange(CORNERS)).ravel()
    p_box = built.p_box(ids)
    at = np.full(len(ids), float(t_ns))
    for _ in range(_ROW_ROUNDS):  # the row in which a corner is seen says when, and that where
        row = _seen(drive, p_box, at, stop)[:, 1] / robot.image_size[1] - 0.5
        at = t_ns + 1e9 * options.readout_s * row
    open_s = options.exposure_s * (np.arange(_EXPOSURE_SAMPLES) / (_EXPOSURE_SAMPLES - 1) - 0.5)
    seen = np.array([_seen(drive, p_box, at + 1e9 * s, stop) for s in (open_s if options.exposure_s > 0 else [0.0])])
    streak = seen[-1] - seen[0]
    cov = options.sigma_px**2 * np.eye(2) + _ALONG**2 * streak[:, :, None] * streak[:, None, :]
    noise = (np.linalg.cholesky(cov) @ rng.standard_normal((len(ids), 2, 1)))[:, :, 0]
    uv_px = seen.mean(axis=0) + noise
    shift = streak.mean(axis=0)
    return MovingFrame(
        t_ns=stamp,
        landmark_ids=ids,
        p_box=p_box,
        faces=target.faces(ids),
        uv_px=uv_px,
        cov_px2=cov,
        blur_px2=_LENS_PX**2 * np.eye(2)
        + np.outer(shift, shift) / 12 * (1 + _BLUR_ERROR * rng.spawn(1)[0].standard_normal()),
    )


def _seen(drive: Drive, p_box: Array, t_ns: Array | Ids, stop: int) -> Array:
    """Return where landmarks (L, 3) are seen, (L, 2) px, each at its own time (L,), ns."""
    unique, which = np.unique(np.rint(t_ns).astype(np.int64), return_inverse=True)
    T_cam_box = np.array([inverse(T) for T in drive.T_box_cam_at(unique, stop)])[which]
    p_cam = (T_cam_box[:, :3, :3] @ p_box[:, :, None])[:, :, 0] + T_cam_box[:, :3, 3]
    return project(drive.scene.cameras[stop], p_cam)
