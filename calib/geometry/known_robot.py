"""Protocol of a robot with known parameters: a calibrated or a simulated one."""

from typing import Protocol

from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel


class KnownRobot(Protocol):
    """A robot with known parameters: an estimate, or a robot as it truly is."""

    @property
    def camera(self) -> CameraModel:
        """Camera model."""

    @property
    def rR(self) -> float:
        """Radius of the right wheel, m."""

    @property
    def rL(self) -> float:
        """Radius of the left wheel, m."""

    @property
    def b(self) -> float:
        """Wheel separation, m."""

    @property
    def T_body_cam(self) -> Array:
        """Camera extrinsics, (4, 4), m."""
