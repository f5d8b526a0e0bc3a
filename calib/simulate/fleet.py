"""Many simulated robots, one after the other or side by side; one that fails does not stop the others."""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.simulate.asked_faults import AskedFaults
from boxcal.calib.simulate.drive import DriveOptions, simulate_drive
from boxcal.calib.simulate.more_cameras import RIGS, OwnSettings, further_cameras, stops_for_all, views_of
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.calib.simulate.robot import VGA, random_robot, with_camera
from boxcal.calib.simulate.truth import truth_bytes
from boxcal.target.box import Target
from boxcal.target.camera.camera_model import CameraKind
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_atomically

_FIRST = "/front/image_raw"
"""Topic of the first camera of a robot that has several."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """Job of one simulated robot.

    Attributes
    ----------
    folder
        Where its log and its truth go.
    number
        From 1; it names the robot and, with the seed, settles everything that is drawn for it.
    seed
        Of the fleet.
    target, drive, record
        The box, the drive and the log.
    image_size
        Of its camera, px.
    kind
        Of its camera model.
    faults
        What is not exact.
    cameras, rig, own
        How many cameras it has, of what kind the second is (:data:`boxcal.calib.simulate.more_cameras.RIGS`), and what
        each has of its own.
    """

    folder: Path
    number: int
    seed: int
    target: Target
    drive: DriveOptions
    record: RecordOptions
    image_size: tuple[int, int] = VGA
    kind: CameraKind = CameraKind.RADIAL
    faults: AskedFaults = field(default_factory=AskedFaults)
    cameras: int = 1
    rig: str = RIGS[0]
    own: OwnSettings = field(default_factory=OwnSettings)

    @property
    def name(self) -> str:
        """The robot's name: r01, r02, ..."""
        return f"r{self.number:02d}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """Outcome of one simulated robot's job.

    Attributes
    ----------
    log
        Its file.
    stops, frames
        How many.
    duration_s : s
        Of the drive.
    error
        Why it failed; empty if it did not.
    """

    log: Path
    stops: int = 0
    frames: int = 0
    duration_s: float = 0.0
    error: str = ""


def simulate_robot(job: Job) -> Done:
    """Draw a robot, drive it, write ``<name>.mcap`` and ``<name>.truth.json``; a failure comes back as text."""
    log = job.folder / f"{job.name}.mcap"
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        of_robot, of_drive, of_log, of_faults = np.random.default_rng([job.seed, job.number]).spawn(4)
        size = job.own.image_sizes[0] if job.own.image_sizes else job.image_size
        robot = with_camera(random_robot(job.name, of_robot, size), job.kind, of_faults)
        faults = job.faults.draw(robot, job.drive, of_faults)
        others = further_cameras(robot, job.cameras - 1, job.rig, of_robot, job.own)
        stops = stops_for_all((robot, *others.values()), job.target, job.drive, of_drive) if others else None
        record = job.own.of(0, job.record)
        record = replace(record, topic=_FIRST, frame="front_optical_frame") if others else record
        drive = simulate_drive(robot, job.target, job.drive, of_drive, stops, faults=faults)
        views = views_of(drive, robot, others, job.record, job.own)
        names, frames = write_log(log, robot, job.target, drive, record, rng=of_log, others=views)
        truth = truth_bytes(robot, drive, job.drive, record, names, note=job.faults.note, others=views)
        write_atomically(job.folder / f"{job.name}.truth.json", truth)
    except (CalibError, TargetError) as error:
        return Done(log=log, error=str(error))
    except OSError as error:
        return Done(
            log=log, error=f"{log}: cannot be written ({error.strerror or error}); free space or name another FOLDER"
        )
    finally:
        cv2.setNumThreads(threads)
    return Done(
        log=log, stops=len(drive.stop_poses), frames=frames, duration_s=float(drive.t_ns[-1] - drive.t_ns[0]) / 1e9
    )


def simulate_fleet(jobs: list[Job], workers: int) -> Iterator[Done]:
    """Do jobs in a number of processes; yield what came of each, in their order, as soon as it is known."""
    if min(workers, len(jobs)) <= 1:
        yield from map(simulate_robot, jobs)
        return
    with ProcessPoolExecutor(min(workers, len(jobs)), mp_context=get_context("spawn")) as pool:
        yield from pool.map(simulate_robot, jobs)
