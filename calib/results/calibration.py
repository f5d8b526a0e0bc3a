"""The calibration of one robot: what its drives gave, and what follows from it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.euler import yaw_pitch_roll, yaw_pitch_roll_sigma
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.results.diagnostics import CAMERA, MOUNTING, Detail
from boxcal.calib.results.rig import Rig
from boxcal.calib.results.verdict import Verdict
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel, project, unproject


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """Goodness of fit of a calibration.

    Attributes
    ----------
    stops, landmarks
        Used, over the whole drive.
    reprojection_rms_px
        Root mean square of the 2-D reprojection errors.
    heading_rms_rad
        Root mean square of turns seen less turns rolled, over all pairs of stops.
    sigma5_sigma4, sigma4_sigma3
        Singular value ratios of step 4: how well one solution fits (0 in the ideal), and how well the moves determine
        it (0.7 is usual, below 0.001 is refused).
    up_error_rad
        Angle between the axis that the robot turns about and the box's own vertical.
    """

    stops: int
    landmarks: int
    reprojection_rms_px: float
    heading_rms_rad: float
    sigma5_sigma4: float
    sigma4_sigma3: float
    up_error_rad: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StopResult:
    """One stop of the drive.

    Attributes
    ----------
    t_start_ns, t_end_ns : ns
        When the robot stood.
    landmarks
        How many were used.
    reprojection_rms_px
        Of this stop.
    T_box_cam : (4, 4), m
        Where the camera was.
    drive
        Number of the drive, from 0, where several were solved together.
    """

    t_start_ns: int
    t_end_ns: int
    landmarks: int
    reprojection_rms_px: float
    T_box_cam: Array
    drive: int = 0


TARGET = "target"
"""The landmark table's name among a result's inputs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Provenance of a result.

    Attributes
    ----------
    version
        Of boxcal.
    command
        As it was given.
    created
        UTC, ISO 8601.
    inputs
        File name -> SHA-256 of its bytes (``target``: of the landmark table). Logs of one name are numbered.
    settings
        Everything that was asked for, defaults included.
    fingerprint
        SHA-256 of logs, target, settings and program together: an equal one stands for an equal result. Empty where it
        was not computed.
    """

    version: str
    command: str
    created: str
    inputs: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    fingerprint: str = ""

    @property
    def logs(self) -> dict[str, str]:
        """The logs among the inputs: name -> SHA-256."""
        return {name: digest for name, digest in self.inputs.items() if name != TARGET}

    @property
    def target(self) -> str:
        """SHA-256 of the landmark table; empty if it was not kept."""
        return self.inputs.get(TARGET, "")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """The calibration of one robot.

    Attributes
    ----------
    robot
        Name: the log's stem.
    image_size : px
        Width and height of the images that the intrinsics belong to.
    camera
        The camera model.
    wheels
        Radii and wheel separation.
    T_body_cam : (4, 4), m
        Camera extrinsics: maps camera points (x right, y down, z forward) to body (x forward, y left, z up, origin on
        the floor below the axle's middle).
    quality
        How well the data fit.
    stops
        What was found for each stop used.
    notes
        What the user should know.
    provenance
        How the result came about.
    method
        ``likelihood``, or ``four-steps`` for the closed form alone.
    detail
        What the likelihood adds: covariance, noise, outliers, what is not determined. None for the closed form.
    findings
        Causes of what noise does not explain: solved for, or only named.
    verdict
        Whether it can be used, and why; None where nobody judged it.
    rig
        All cameras of the robot that could be used, where several were asked for; this calibration is of one of them.
        None where one was.

    Examples
    --------
    >>> import boxcal
    >>> found = boxcal.load_calibration("calibration/r01/calibration.json")
    >>> reasons = [(reason.rule, str(reason.level), reason.text) for reason in found.verdict.reasons]
    >>> yaw, pitch, roll = found.yaw_pitch_roll
    >>> pixels = found.project([[1.0, 0.0, 0.1], [1.0, 0.1, 0.1]])  # m, frame body: 1 m ahead, 0.1 m above the floor
    >>> directions = found.unproject(pixels)  # from the camera at found.T_body_cam[:3, 3]
    >>> found.camera_matrix.shape, found.distortion.shape, pixels.shape, directions.shape
    ((3, 3), (4,), (2, 2), (2, 3))
    """

    robot: str
    image_size: tuple[int, int]
    camera: CameraModel
    wheels: Wheels
    T_body_cam: Array
    quality: Quality
    stops: tuple[StopResult, ...]
    notes: tuple[str, ...]
    provenance: Provenance
    method: str = "four-steps"
    detail: Detail | None = None
    findings: tuple[Finding, ...] = ()
    verdict: Verdict | None = None
    rig: Rig | None = None

    @property
    def camera_matrix(self) -> Array:
        """OpenCV's camera matrix, (3, 3) px; pixel (0, 0) is the centre of the top-left pixel."""
        return self.camera.K

    @property
    def distortion(self) -> Array:
        """Distortion coefficients in OpenCV's order: k1, k2, p1, p2 [k3 [k4 k5 k6]], or the fisheye's k1 to k4."""
        k = np.array(self.camera.distortion)
        return np.concatenate([k, np.zeros(3)]) if self.camera.kind is CameraKind.RADIAL else k

    @property
    def yaw_pitch_roll(self) -> tuple[float, float, float]:
        """Camera direction as yaw to the left, pitch down and roll, rad; zeros for straight ahead."""
        return yaw_pitch_roll(self.T_body_cam[:3, :3])

    @property
    def yaw_pitch_roll_sigma(self) -> Array:
        """Standard deviations of yaw, pitch and roll, (3,) rad; NaN for the closed form, infinite if not determined."""
        if self.detail is None:
            return np.full(3, np.nan)
        return yaw_pitch_roll_sigma(self.T_body_cam[:3, :3], self.detail.covariance.block(("rx", "ry", "rz")))

    @property
    def projection_covariance(self) -> Array:
        """Covariance (n + 6, n + 6) of what projects a point: the camera's ``values``, then the camera extrinsics.

        Files of before 0.2 say nothing of coefficients beyond kr; they count as exact there. NaN for the closed form.
        """
        n = len(self.camera.values)
        if self.detail is None:
            return np.full((n + 6, n + 6), np.nan)
        if self.detail.camera_covariance is not None:
            return self.detail.camera_covariance.matrix
        cov = np.zeros((n + 6, n + 6))
        known = [*range(5), *range(n, n + 6)]
        cov[np.ix_(known, known)] = self.detail.covariance.block(CAMERA + MOUNTING)
        return cov

    def project(self, p_body: ArrayLike) -> Array:
        """Return the pixels (N, 2) of points (N, 3), m, known in frame ``body``; NaN behind the camera."""
        p_cam = (np.asarray(p_body, dtype=np.float64) - self.T_body_cam[:3, 3]) @ self.T_body_cam[:3, :3]
        return project(self.camera, p_cam)

    def unproject(self, uv_px: ArrayLike) -> Array:
        """Return the directions (N, 3), of length 1 along the body's axes, in which pixels (N, 2) see; NaN if nowhere.

        The rays start at the camera, ``T_body_cam[:3, 3]``.
        """
        xy = unproject(self.camera, np.asarray(uv_px, dtype=np.float64))
        rays = np.column_stack([xy, np.ones(len(xy))])
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True) @ self.T_body_cam[:3, :3].T)
