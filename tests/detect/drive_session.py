"""One simulated drive and its pictures, made once: what each kind of recording is then written from."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from boxcal.calib.likelihood import CameraKind
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.recorder import RecordOptions, frame_times, take_picture
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import make_target

TARGET, ROBOT = make_target(), turtlebot()
SETTINGS = Settings(report=False, lens=CameraKind.RADIAL)
PARAMETERS = ("rR", "rL", "b")


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """What the robot's encoders and camera would have said, exactly.

    Attributes
    ----------
    angles
        Stamps (S,) ns, and angles of the right and the left wheel (S,) rad.
    pictures
        Stamps, ns, and grey pictures: one at each stop.
    """

    angles: tuple[Ids, Array, Array]
    pictures: list[tuple[int, NDArray[np.uint8]]]


@cache
def session(stops: int = 8) -> Session:
    """Return the drive (a second of processor time, once in a process)."""
    rng = np.random.default_rng(3)
    options = DriveOptions(stops=stops, slip=1e-4, encoder_step=0.0, stand_s=(0.8, 0.9), max_speed=0.6)
    drive = simulate_drive(ROBOT, TARGET, options, rng)
    record = RecordOptions(frames=1, moving_frames=0)
    pictures = [
        (t, take_picture(ROBOT, TARGET, drive, t, options=record, rng=rng))
        for t in frame_times(drive, record, rng).tolist()
    ]
    return Session(angles=(drive.t_ns, drive.phi_R, drive.phi_L), pictures=pictures)


def solution(c: Calibration) -> Array:
    """Return all that a calibration says of a robot as one vector: wheels, camera, mounting."""
    wheels = [getattr(c.wheels, name) for name in PARAMETERS]
    return np.concatenate([wheels, c.camera_matrix.ravel(), c.T_body_cam.ravel()])
