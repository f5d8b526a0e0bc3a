"""One drive as a log: which images are taken when, and all messages in the order in which a recorder gets them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import atan2, hypot
from pathlib import Path

import cv2
import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.as_built import flat_as_built
from boxcal.calib.simulate.drive import Drive
from boxcal.calib.simulate.imperfections import Imperfections
from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array, Ids, Image
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.render.renderer import encode_jpeg, render
from boxcal.target.render.sensor import MAX_PSF_PX, SensorModel

IMAGES = ("jpeg", "png", "raw")
CAMERA_TOPIC = "/camera/image_raw"
JOINT_TOPIC = "/joint_states"
LEFT_JOINT, RIGHT_JOINT = "left_wheel_joint", "right_wheel_joint"

_JOINTS_LATE_NS = 2e6
_CAMERA_LATE_NS = 30e6
_BEFORE_CAMERA = np.array([0.0, 0.0, 0.6])
_NEARBY_NS = 1_000_000
_BAND_ROWS = 8
_SOUND = Imperfections().box


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordOptions:
    """Contents of a simulated log.

    Attributes
    ----------
    frames
        Images at each stop.
    moving_frames
        Images between two stops.
    image
        ``jpeg``, ``png`` (both ``CompressedImage``) or ``raw`` (``Image``, mono8).
    quality
        Of JPEG, 1 to 100.
    compression
        Of the file's chunks: ``none``, ``lz4`` or ``zstd``.
    exposure_s : s
        How long the shutter is open; images taken on the move are blurred by it.
    late_s : s
        Stamps of the images less the middle of their exposure, in the middle of the drive.
    clock_rate : s/s
        How much later they are stamped for each second that passes.
    clock_jump_s : s
        How much later they are stamped from the middle of the drive on.
    wheels_jump_s : s
        How much later the wheels' clock stamps from the middle of the drive on.
    jitter_s : s
        Standard deviation of each stamp's own error.
    readout_s : s
        Time from the first row to the last of a rolling shutter; the middle row is seen at the image's time.
    sensor
        Lens and sensor.
    topic, frame
        Of raw images, and the frame that they name.
    """

    frames: int = 3
    moving_frames: int = 2
    image: str = "jpeg"
    quality: int = 90
    compression: str = "zstd"
    exposure_s: float = 0.008
    late_s: float = 0.0
    clock_rate: float = 0.0
    clock_jump_s: float = 0.0
    wheels_jump_s: float = 0.0
    jitter_s: float = 0.0
    readout_s: float = 0.0
    sensor: SensorModel = field(default_factory=lambda: SensorModel(noise=1.5, psf_px=0.6, vignetting=0.2, srgb=True))
    topic: str = CAMERA_TOPIC
    frame: str = "camera"

    def __post_init__(self) -> None:
        if self.image not in IMAGES:
            raise CalibError(f"image {self.image!r}: one of {', '.join(IMAGES)} is needed", remedy="choose one")

    @property
    def camera_topic(self) -> str:
        """The topic of the images."""
        return self.topic if self.image == "raw" else f"{self.topic}/compressed"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """A drive as one camera sees it, and how its images are recorded.

    Attributes
    ----------
    robot
        The robot with that camera.
    drive
        The drive, with that camera's poses.
    options
        Of its images.
    """

    robot: Robot
    drive: Drive
    options: RecordOptions


def frame_times(drive: Drive, options: RecordOptions, rng: np.random.Generator) -> Ids:
    """Return the stamps of all images, (F,) int64 ns, ascending.

    Those of a stop are spread evenly over it, off its ends; those of a leg are drawn from its middle nine tenths.
    """
    fraction = np.arange(1, options.frames + 1) / (options.frames + 1)
    begun, ended = drive.stop_t_ns[:, :1], drive.stop_t_ns[:, 1:]
    still = begun + fraction * (ended - begun)
    moving = ended[:-1] + rng.uniform(0.05, 0.95, (len(begun) - 1, options.moving_frames)) * (begun[1:] - ended[:-1])
    return np.asarray(np.sort(np.rint(np.concatenate([still.ravel(), moving.ravel()])).astype(np.int64)))


def write_log(
    path: Path,
    robot: Robot,
    target: Target,
    drive: Drive,
    options: RecordOptions,
    *,
    rng: np.random.Generator,
    others: Sequence[View] = (),
) -> tuple[tuple[str, str], int]:
    """Write a drive's log; return the joints' names in the order of the messages, and the number of images.

    ``others`` are more cameras of the robot.

    Header stamps are the true times, but for a fault of the camera's clock. Log times are later, by some 2 ms for
    joints and 30 ms for images.

    Raises
    ------
    CalibError
        If the compression is none that logs have.
    OSError
        As the file system does.
    """
    left_first = bool(rng.random() < 0.5)
    names = (LEFT_JOINT, RIGHT_JOINT) if left_first else (RIGHT_JOINT, LEFT_JOINT)
    phi = np.stack([drive.phi_L, drive.phi_R] if left_first else [drive.phi_R, drive.phi_L], axis=1)
    velocity = np.diff(phi, axis=0, prepend=phi[:1]) / np.diff(drive.t_ns, prepend=drive.t_ns[0] - 1)[:, None] * 1e9
    frames = frame_times(drive, options, rng)
    late = (
        _JOINTS_LATE_NS + rng.exponential(0.2e6, len(drive.t_ns)),
        _CAMERA_LATE_NS + rng.exponential(2e6, len(frames)),
    )
    view = View(robot=robot, drive=drive, options=options)
    stamps = frames + stamps_late_ns(drive, frames) + _stamp_errors_ns(view, frames, rng)
    joints_log = drive.t_ns + late[0].astype(np.int64)
    half_way = (drive.path_t_ns[0] + drive.path_t_ns[-1]) // 2
    joints = drive.t_ns + round(1e9 * options.wheels_jump_s) * (drive.t_ns > half_way)
    first = _Pictures(
        view=view,
        t_ns=frames,
        stamps=stamps,
        log_ns=frames + late[1].astype(np.int64),
        rng=rng,
    )
    every = [first, *(_pictures_of(view, rng.spawn(1)[0]) for view in others)]
    of = np.repeat(np.arange(len(every)), [len(p.t_ns) for p in every])
    number = np.concatenate([np.arange(len(p.t_ns)) for p in every])
    order = np.argsort(np.concatenate([joints_log, *(p.log_ns for p in every)]), kind="stable")
    with LogWriter(path, compression=options.compression) as log:
        for row in order.tolist():
            if row < len(joints_log):
                stamp, log_ns = int(joints[row]), int(joints_log[row])
                log.joint_state(JOINT_TOPIC, stamp, log_ns, names, phi[row], velocity[row])
            else:
                k = row - len(joints_log)
                every[of[k]].write(log, target, int(number[k]))
    return names, len(of)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pictures:
    """Images of one camera: when they are taken, stamped and recorded, ns."""

    view: View
    t_ns: Ids
    stamps: Ids
    log_ns: Ids
    rng: np.random.Generator

    def write(self, log: LogWriter, target: Target, k: int) -> None:
        """Take an image and write it."""
        view = self.view
        picture = take_rows(view.robot, target, view.drive, int(self.t_ns[k]), options=view.options, rng=self.rng)
        _write_picture(log, picture, int(self.stamps[k]), int(self.log_ns[k]), view.options)


def _pictures_of(view: View, rng: np.random.Generator) -> _Pictures:
    frames = frame_times(view.drive, view.options, rng)
    return _Pictures(
        view=view,
        t_ns=frames,
        stamps=frames + stamps_late_ns(view.drive, frames) + _stamp_errors_ns(view, frames, rng),
        log_ns=frames + (_CAMERA_LATE_NS + rng.exponential(2e6, len(frames))).astype(np.int64),
        rng=rng,
    )


def stamps_late_ns(drive: Drive, t_ns: Ids) -> Ids:
    """Return how late, ns, the camera's clock stamps images taken at times (N,), ns."""
    faults = drive.faults.camera
    since = t_ns - drive.path_t_ns[0]
    return np.asarray(np.rint(faults.late * 1e9 + faults.drift * since), dtype=np.int64)


def _stamp_errors_ns(view: View, t_ns: Ids, rng: np.random.Generator) -> Ids:
    """Return the errors of stamps, (N,), ns, at times (N,), ns: an offset, a rate, a jump, and jitter where asked."""
    options, path = view.options, view.drive.path_t_ns
    since_s = (t_ns - (path[0] + path[-1]) // 2) / 1e9
    late = options.late_s + options.clock_rate * since_s + options.clock_jump_s * (since_s > 0)
    if options.jitter_s > 0:
        late = late + options.jitter_s * rng.standard_normal(len(t_ns))
    return np.asarray(np.rint(1e9 * late), dtype=np.int64)


def take_rows(
    robot: Robot, target: Target, drive: Drive, t_ns: int, *, options: RecordOptions, rng: np.random.Generator
) -> Image:
    """Return the image (H, W) of a shutter that may roll; see :func:`take_picture`.

    A rolling shutter is made of bands of a few rows, each of an image taken at the time of its middle row.
    """
    height = robot.image_size[1]
    rows = np.arange(0, height, _BAND_ROWS)
    times = t_ns + np.rint(1e9 * options.readout_s * ((rows + _BAND_ROWS / 2) / height - 0.5)).astype(np.int64)
    poses = drive.pose_at(np.clip(times[[0, -1]], drive.path_t_ns[0], drive.path_t_ns[-1]))
    if options.readout_s == 0 or np.array_equal(poses[0], poses[1]):
        return take_picture(robot, target, drive, t_ns, options=options, rng=rng)
    bands = [take_picture(robot, target, drive, int(time), options=options, rng=rng) for time in times]
    return np.concatenate([band[row : row + _BAND_ROWS] for row, band in zip(rows, bands, strict=True)])


def take_picture(
    robot: Robot, target: Target, drive: Drive, t_ns: int, *, options: RecordOptions, rng: np.random.Generator
) -> Image:
    """Return the image (H, W) that the robot takes at a time, ns, of the box as it was built and placed then.

    An image on the move is blurred along the path of a point 0.6 m before the camera.
    """
    stop, box = drive.stop_at(t_ns), drive.faults.box
    camera = drive.scene.cameras[stop]
    T_box_cam = drive.T_box_cam_at(np.array([t_ns - _NEARBY_NS, t_ns, t_ns + _NEARBY_NS]), stop)
    streak = _motion_px(camera, T_box_cam) * (options.exposure_s * 1e9 / (2 * _NEARBY_NS))
    sensor = replace(
        options.sensor, motion_blur_px=min(hypot(*streak), MAX_PSF_PX), motion_angle=atan2(streak[1], streak[0])
    )
    a, b, c, d = box.bow
    built = target if box is _SOUND else _as_built(target, drive.faults)
    T_cam_box = inverse(T_box_cam[1])
    T_cam_floor = None if box.standing is None else T_cam_box @ drive.scene.T_box_floor[stop]
    return render(built, camera, T_cam_box, robot.image_size, sensor, rng, bow=(a, b, c, d), T_cam_floor=T_cam_floor)


@lru_cache(maxsize=4)
def _as_built(target: Target, faults: Imperfections) -> Target:
    return flat_as_built(target, faults.box)


def _motion_px(camera: CameraModel, T_box_cam: Array) -> Array:
    """Return how far a point before the camera moves in the image from the first of three poses to the last, px."""
    p_box = T_box_cam[1][:3, :3] @ _BEFORE_CAMERA + T_box_cam[1][:3, 3]
    ends = [inverse(T) for T in (T_box_cam[0], T_box_cam[2])]
    before, after = (project(camera, T[:3, :3] @ p_box + T[:3, 3]) for T in ends)
    return np.asarray(after - before)


def _write_picture(log: LogWriter, picture: Image, stamp_ns: int, log_ns: int, options: RecordOptions) -> None:
    if options.image == "raw":
        log.image(options.camera_topic, stamp_ns, log_ns, picture, "mono8", frame_id=options.frame)
        return
    if options.image == "jpeg":
        data = encode_jpeg(picture, options.quality)
    else:
        data = cv2.imencode(".png", picture)[1].tobytes()
    kind = f"mono8; {options.image} compressed mono8"
    log.compressed_image(options.camera_topic, stamp_ns, log_ns, data, kind, frame_id=options.frame)
