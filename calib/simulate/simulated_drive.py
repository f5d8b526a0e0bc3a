"""A simulated drive without images: what a good detector would extract from its log, and the truth."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import Robot, turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Target, make_target


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedDrive:
    """One robot's simulated drive around the box.

    Attributes
    ----------
    robot
        The robot as it truly is: camera, wheels and camera extrinsics.
    target
        The box.
    drive
        Wheel samples, true poses and the true path.
    correspondences
        What the robot saw and what its wheels did: the calibration's input.
    """

    robot: Robot
    target: Target
    drive: Drive
    correspondences: Correspondences


def simulate(
    robot: Robot | None = None,
    target: Target | None = None,
    *,
    stops: int = 12,
    seed: int = 0,
    sigma_px: float = 0.1,
    options: DriveOptions | None = None,
) -> SimulatedDrive:
    """Return a simulated drive around the box; the same arguments give the same drive.

    Parameters
    ----------
    robot
        Who drives; a robot of the size of a TurtleBot3 Burger if not given.
    target
        The box; the default box if not given.
    stops
        Number of stops, where ``options`` does not say.
    seed
        Settles stops, paths, slip and noise.
    sigma_px : px
        Standard deviation of the corners' noise.
    options
        Encoders, slip, speeds; the defaults if not given.

    Raises
    ------
    CalibError
        If there is no place to see the box from.

    Examples
    --------
    >>> import boxcal
    >>> simulated = boxcal.simulate(stops=5, seed=1)
    >>> len(simulated.correspondences.stops)
    5
    >>> simulated.robot.b  # m, the true wheel separation
    0.1623
    """
    robot, target = robot or turtlebot(), target or make_target()
    of_drive, of_pixels = np.random.default_rng(seed).spawn(2)
    drive = simulate_drive(robot, target, options or DriveOptions(stops=stops), of_drive)
    return SimulatedDrive(
        robot=robot,
        target=target,
        drive=drive,
        correspondences=exact_correspondences(robot, target, drive, sigma_px, of_pixels),
    )
