"""All cameras of one robot: where each sits, how certain that is, and the transform between any two."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from boxcal.calib.geometry.camera_pair import between, pair_jacobian
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.results.diagnostics import MOUNTING, Covariance
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigCamera:
    """One of several cameras of a robot.

    Attributes
    ----------
    name
        Made of its topic; names the folder of its own results beside those of the first camera.
    topic, frame
        Of its images, and the frame that these name.
    image_size : px
        Width and height of its images.
    camera
        Camera model.
    T_body_cam : (4, 4), m
        Camera extrinsics.
    stops
        How many it was used at.
    reprojection_rms_px
        Root mean square of its 2-D reprojection errors.
    clock_offset : s
        By how much its clock was ahead of the wheels' before its stamps were put right, by what frames on the move
        say where they were used.
    landmarks
        Corners used, over all stops.
    verdict, why
        Level of its own verdict, and the causes of one that is not good; empty where nobody judged it.
    covariance
        Of its reported parameters, the wheels' among them, as in its own result; None in files of before 0.2.
    """

    name: str
    topic: str
    frame: str
    image_size: tuple[int, int]
    camera: CameraModel
    T_body_cam: Array
    stops: int
    reprojection_rms_px: float
    clock_offset: float = 0.0
    landmarks: int = 0
    verdict: str = ""
    why: str = ""
    covariance: Covariance | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPair:
    """Transform between two cameras of a robot.

    Attributes
    ----------
    a, b
        Names of the cameras.
    T_a_b : (4, 4), m
        Maps points of camera b to camera a.
    covariance : (6, 6)
        Of its rotation (right perturbation, about b's axes, rad), then of its translation (along a's axes, m).
    """

    a: str
    b: str
    T_a_b: Array
    covariance: Array

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviations of rx, ry, rz (rad), tx, ty, tz (m)."""
        return dict(zip(MOUNTING, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def distance(self) -> tuple[float, float]:
        """Distance between the two, m, and its standard deviation."""
        return _length(self.T_a_b[:3, 3], self.covariance[3:, 3:])

    @property
    def angle(self) -> tuple[float, float]:
        """Angle of the rotation between the two, rad, and its standard deviation."""
        return _length(log_so3(self.T_a_b[:3, :3]), self.covariance[:3, :3])


def _length(v: Array, cov: Array) -> tuple[float, float]:
    """Return the length of a vector (3,), and its standard deviation."""
    length = float(np.linalg.norm(v))
    along = v / length if length > 0 else np.zeros(3)
    return length, float(np.sqrt(max(float(along @ cov @ along), 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """All cameras of one robot.

    Attributes
    ----------
    cameras
        The first is the one that the robot's own calibration is of.
    covariance : (6 C, 6 C)
        Of all camera extrinsics together: rx, ry, rz, tx, ty, tz of one camera after the other, each as in the
        calibration's own covariance.
    left_out
        Why an image topic is not among them, by topic.
    apart
        Why the cameras were not solved together, and the covariance is an upper bound of what differences between
        cameras have; empty if they were.
    stops
        How many stops they were solved at together, each counted once; 0 if they were not, or where nobody counted.

    Examples
    --------
    >>> import boxcal
    >>> found = boxcal.load_calibration("calibration/r01/calibration.json")
    >>> if found.rig is not None:
    ...     T_front_rear, cov = (pair := found.rig.pair("front", "rear")).T_a_b, pair.covariance
    """

    cameras: tuple[RigCamera, ...]
    covariance: Array
    left_out: tuple[tuple[str, str], ...] = ()
    apart: str = ""
    stops: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the cameras."""
        return tuple(camera.name for camera in self.cameras)

    def pair(self, a: str, b: str) -> CameraPair:
        """Return the transform between two cameras by their names (ValueError if there is no such camera)."""
        i, j = self.names.index(a), self.names.index(b)
        T_a, T_b = self.cameras[i].T_body_cam, self.cameras[j].T_body_cam
        rows = [*range(6 * i, 6 * i + 6), *range(6 * j, 6 * j + 6)]
        J = pair_jacobian(T_a, T_b)
        cov = J @ self.covariance[np.ix_(rows, rows)] @ J.T
        return CameraPair(a=a, b=b, T_a_b=between(T_a, T_b), covariance=(cov + cov.T) / 2)

    @property
    def pairs(self) -> tuple[CameraPair, ...]:
        """All pairs, each once."""
        return tuple(self.pair(a, b) for a, b in combinations(self.names, 2))
