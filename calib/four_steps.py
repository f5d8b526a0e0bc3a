"""The paper's procedure: four closed-form steps, in order."""

from dataclasses import dataclass

from calib.axis import AxisStep, find_axis
from calib.camera import CameraMode, CameraStep, calibrate_camera
from calib.errors import CalibError
from calib.heading import HeadingStep, solve_heading
from calib.mounting import MountingStep, solve_mounting
from calib.odometry import legs_between
from detect.correspondences import Correspondences

MIN_STOPS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class FourSteps:
    """The outcome of the four steps, each with what it found."""

    camera: CameraStep
    axis: AxisStep
    heading: HeadingStep
    mounting: MountingStep

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know about the result."""
        return self.camera.notes + self.axis.notes


def solve_four_steps(drive: Correspondences, mode: CameraMode = CameraMode.JOINT) -> FourSteps:
    """Return the calibration of one robot by the procedure of Antonelli et al. 2010 (DOI 10.1007/s11370-010-0067-2).

    Step 3 is taken before step 2, which uses its signed angles.

    Parameters
    ----------
    drive
        What the robot saw at its stops, and what its wheels did between them.
    mode
        One camera for all stops, or the paper's calibration of every stop alone.

    Raises
    ------
    CalibError
        If the drive does not determine the calibration: what is missing, and what to add.
    """
    if len(drive.stops) < MIN_STOPS:
        raise CalibError(f"{len(drive.stops)} usable stops, at least {MIN_STOPS} are needed; add stops")
    camera = calibrate_camera(drive.stops, drive.image_size, mode)
    if len(camera.kept) < MIN_STOPS:
        raise CalibError(
            f"{len(camera.kept)} of {len(drive.stops)} stops can be used, at least {MIN_STOPS} are needed "
            f"({'; '.join(camera.notes)})"
        )
    legs = legs_between(drive, camera.kept)
    axis = find_axis(camera.T_cam_box)
    heading = solve_heading(axis.theta, legs.phi_R, legs.phi_L)
    mounting = solve_mounting(
        camera.T_cam_box, legs, theta=axis.theta, a2=axis.a2, a3=axis.a3, aR=heading.aR, aL=heading.aL
    )
    return FourSteps(camera=camera, axis=axis, heading=heading, mounting=mounting)
