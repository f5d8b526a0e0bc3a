"""A small simulated drive: as a log, as messages in the order in which they were recorded, and as correspondences."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.imperfections import Imperfections, WheelFaults
from boxcal.calib.simulate.recorder import RecordOptions, write_log
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.containers.mcap import McapFile
from boxcal.target.box import make_target

TARGET = make_target()


def logged(path: Path, stops: int = 4, frames: int = 5) -> Path:
    rng = np.random.default_rng(3)
    robot = turtlebot("r01")
    drive = simulate_drive(robot, TARGET, DriveOptions(stops=stops, stand_s=(2.4, 2.9)), rng)
    write_log(path, robot, TARGET, drive, options=RecordOptions(frames=frames, moving_frames=2), rng=rng)
    return path


def messages(path: Path) -> list[LiveMessage]:
    with path.open("rb") as file:
        found = [
            LiveMessage(batch.channel, log, bytes(data), "image" in batch.channel.topic)
            for piece in McapFile(file, path.name).batches()
            for batch in piece
            for data, log in batch.messages()
        ]
    return sorted(found, key=lambda m: m.log_ns)


def in_steps(of: list[LiveMessage], step_ns: int = 100_000_000) -> Iterator[list[LiveMessage]]:
    """Messages in the pieces in which they would have been taken."""
    piece: list[LiveMessage] = []
    until = of[0].log_ns + step_ns
    for message in of:
        if message.log_ns >= until:
            yield piece
            piece, until = [], message.log_ns + step_ns
        piece.append(message)
    yield piece


def seen(stops: int, seed: int = 1, wheels: WheelFaults | None = None) -> Correspondences:
    """Correspondences of a drive without pictures."""
    rng = np.random.default_rng(seed)
    robot = turtlebot("r01")
    faults = None if wheels is None else Imperfections(wheels=wheels)
    drive = simulate_drive(robot, TARGET, DriveOptions(stops=stops), rng, faults=faults)
    found = exact_correspondences(robot, TARGET, drive, 0.05, rng)
    faced = tuple(replace(stop, faces=TARGET.faces(stop.landmark_ids)) for stop in found.stops)
    return replace(found, stops=faced)
