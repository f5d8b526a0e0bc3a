"""The paper's procedure: four closed-form steps, in order."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.step1_camera import CameraStep, calibrate_camera
from boxcal.calib.four_steps.step2_heading import HeadingStep, solve_heading
from boxcal.calib.four_steps.step3_axis import AxisStep, find_axis
from boxcal.calib.four_steps.step4_mounting import (
    MountingStep,
    check_agreement,
    solve_mounting,
    stand_on_floor,
    upright_translations,
)
from boxcal.calib.geometry.diff_drive import Legs, legs_between, pair_displacements, stop_pairs, unit_path
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.stops import MIN_STOPS
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FourSteps:
    """The outcome of the four steps.

    Attributes
    ----------
    camera, axis, heading, mounting
        What each step found.
    T_body_cam : (4, 4), m
        The camera extrinsics put together.
    replaced
        Why steps 2 and 4 failed over all pairs of stops, where consecutive stops took their place; else empty.
    """

    camera: CameraStep
    axis: AxisStep
    heading: HeadingStep
    mounting: MountingStep
    T_body_cam: Array
    replaced: str = ""

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user about the result."""
        if not self.replaced:
            return self.camera.notes + self.axis.notes
        remark = f"started from consecutive stops, as no calibration fits all pairs of stops: {self.replaced}"
        return (*self.camera.notes, *self.axis.notes, remark)


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
        raise CalibError(f"{len(drive.stops)} usable stops, at least {MIN_STOPS} are needed", remedy="add stops")
    camera = calibrate_camera(drive.stops, drive.image_size, mode)
    if len(camera.kept) < MIN_STOPS:
        raise CalibError(
            f"{len(camera.kept)} of {len(drive.stops)} stops can be used, at least {MIN_STOPS} are needed "
            f"({'; '.join(camera.notes)})"
        )
    return solve_motion(camera, legs_between(drive, camera.kept))


@lru_cache(maxsize=1)  # as step 1's: the same camera poses and legs are asked for again a moment later
def solve_motion(camera: CameraStep, legs: Legs) -> FourSteps:
    """Return the calibration from the camera's poses and the wheels' travel: steps 3, 2 and 4.

    Parameters
    ----------
    camera
        Outcome of step 1.
    legs
        Wheel travel between its stops.

    Raises
    ------
    CalibError
        If the moves do not determine the calibration.
    """
    axis = find_axis(camera.T_cam_box)
    i, j = stop_pairs(len(camera.T_cam_box))
    phi = np.stack([legs.phi_R, legs.phi_L], axis=1)
    heading = solve_heading(-axis.theta[i, j], phi[j] - phi[i], moves=len(phi) - 1)
    u = upright_translations(camera.T_cam_box, axis.a2, axis.a3)
    beta = pair_displacements(*unit_path(legs, heading.aR, heading.aL))
    mounting = solve_mounting(beta=beta, theta=axis.theta[i, j], u=u, aR=heading.aR, aL=heading.aL)
    check_agreement(mounting, u)
    T_body_cam = stand_on_floor(mounting, camera.T_cam_box, axis.a2, axis.a3)
    return FourSteps(camera=camera, axis=axis, heading=heading, mounting=mounting, T_body_cam=T_body_cam)
