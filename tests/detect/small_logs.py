"""Small logs for the tests of detect: a robot that stands and drives by turns, written in a few milliseconds."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids

T0_NS = 1_700_000_000_000_000_000
STEP = np.deg2rad(0.1302)
JOINTS = "/joint_states"
CAMERA = "/camera/image_raw"
COMPRESSED = "/camera/image_raw/compressed"
LEFT, RIGHT = "left_wheel_joint", "right_wheel_joint"


def drive(
    *, stops: int = 4, rate_hz: float = 50.0, stand: float = 1.0, move: float = 1.0, step: float = STEP
) -> tuple[Ids, Array, Array, Array]:
    """Return stamps (S,) ns, angles right and left (S,) rad, and when it stood (stops, 2) s.

    The wheels' speeds are smooth bumps of about 5 rad/s; angles are rounded to encoder steps (0: not rounded).
    """
    period = stand + move
    t = np.arange(0, stops * period - move + 1e-9, 1 / rate_hz)
    leg = np.floor(t / period)
    x = np.clip((t - leg * period - stand) / move, 0, 1)
    done = leg + x - np.sin(2 * np.pi * x) / (2 * np.pi)
    begin = np.arange(stops) * period
    phi_R, phi_L = 1.234 + 5.1 * move * done, -0.5 + 4.3 * move * done
    if step:
        phi_R, phi_L = np.floor(phi_R / step) * step, np.floor(phi_L / step) * step
    return T0_NS + np.round(t * 1e9).astype(np.int64), phi_R, phi_L, np.stack([begin, begin + stand], axis=1)


def samples(**how: float) -> WheelSamples:
    t_ns, phi_R, phi_L, _ = drive(**how)  # type: ignore[arg-type]
    return WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L)


def blank(height: int = 8, width: int = 12) -> NDArray[np.uint8]:
    return np.arange(height * width, dtype=np.uint8).reshape(height, width)


def jpeg(image: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".jpg", image)[1].tobytes()


def write_joints(log: LogWriter, topic: str = JOINTS, **how: float) -> None:
    t_ns, phi_R, phi_L, _ = drive(**how)  # type: ignore[arg-type]
    for t, right, left in zip(t_ns.tolist(), phi_R, phi_L, strict=True):
        log.joint_state(topic, t, t + 2_000_000, [LEFT, RIGHT], [left, right])


def write_frames(log: LogWriter, topic: str = CAMERA, count: int = 4, *, start_ns: int = T0_NS) -> None:
    for k in range(count):
        t = start_ns + round((0.5 + 2 * k) * 1e9)
        log.image(topic, t, t + 30_000_000, blank() + np.uint8(k))


def write_small(path: Path, *, compression: str = "zstd", chunk_bytes: int = 1 << 14) -> Path:
    """Write a good log: four stops, one 12 x 8 image at each."""
    with LogWriter(path, compression=compression, chunk_bytes=chunk_bytes) as log:
        write_joints(log)
        write_frames(log)
    return path


def write_log(path: Path, *parts: Callable[[LogWriter], None]) -> Path:
    """Write a log of parts, each given the writer."""
    with LogWriter(path) as log:
        for part in parts:
            part(log)
    return path
