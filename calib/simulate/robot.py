"""The robots that are driven: their true wheels, cameras and extrinsics."""

from dataclasses import dataclass, replace
from math import atan2, radians

import numpy as np

from boxcal.calib.geometry.so3_se3 import nearest_rotation, rigid, rot_y, rot_z
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel

VGA = (640, 480)

_R_LEVEL_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Maps camera axes (x right, y down, z forward) of a level camera that looks ahead to body axes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """One robot as it truly is.

    Attributes
    ----------
    name
        Of the robot and of its files.
    camera, image_size
        Intrinsics; width and height, px.
    rR, rL, b : m
        Radius of the right and the left wheel; distance between their points of contact.
    T_body_cam : (4, 4), m
        Maps camera points (x right, y down, z forward) to body (x forward, y left, z up, origin on the floor below
        the axle's midpoint).
    """

    name: str
    camera: CameraModel
    image_size: tuple[int, int]
    rR: float
    rL: float
    b: float
    T_body_cam: Array

    @property
    def reach(self) -> float:
        """Distance from the body's origin to its outermost part (a wheel or the camera), seen from above, m."""
        return max(self.b / 2, float(np.hypot(*self.T_body_cam[:2, 3])))


def mount(
    *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0, x: float = 0.0, y: float = 0.0, z: float = 0.0
) -> Array:
    """Return ``T_body_cam`` of a camera at (x, y, z), m, first level and ahead, then turned.

    Parameters
    ----------
    yaw, pitch, roll : rad
        To the left, then down, then clockwise as the camera sees itself (about its optical axis).
    """
    return rigid(rot_z(yaw) @ rot_y(pitch) @ _R_LEVEL_OPTICAL @ rot_z(roll), np.array([x, y, z]))


def paper(name: str = "paper") -> Robot:
    """Return the robot of the simulation in Antonelli et al. 2010, section 4 (DOI 10.1007/s11370-010-0067-2).

    Wheels and extrinsics are the paper's: ``R = Rz(0) Ry(1.396) Rz(0)`` looks ahead and 10 deg up from floor level, the
    image's u axis pointing down and its v axis to the left. The paper gives no intrinsics; these are ours.
    """
    return Robot(
        name=name,
        camera=CameraModel(fu=600.0, fv=600.0, cu=319.5, cv=239.5, kr=-0.1),
        image_size=VGA,
        rR=0.03,
        rL=0.03,
        b=0.08,
        T_body_cam=rigid(rot_y(1.396), np.array([0.03, 0.0, 0.0])),
    )


def khepera(name: str = "khepera") -> Robot:
    """Return the Khepera III as the paper's experiment found it (section 5 and eq. 37); cu, cv and kr are ours."""
    R = np.array([[-0.0338, 0.0531, 0.9980], [0.0020, 0.9986, -0.0531], [-0.9994, 0.0002, -0.0339]])
    return Robot(
        name=name,
        camera=CameraModel(fu=1013.0, fv=1024.0, cu=325.0, cv=236.0, kr=-0.15),
        image_size=VGA,
        rR=0.0209,
        rL=0.0208,
        b=0.0891,
        T_body_cam=rigid(nearest_rotation(R), np.array([0.0311, -0.0011, 0.1123])),
    )


def turtlebot(name: str = "turtlebot") -> Robot:
    """Return a robot of the size of a TurtleBot3 Burger, its camera on top and tilted down."""
    return Robot(
        name=name,
        camera=CameraModel(fu=612.9, fv=614.4, cu=311.8, cv=247.2, kr=-0.08),
        image_size=VGA,
        rR=0.03271,
        rL=0.03318,
        b=0.1623,
        T_body_cam=mount(yaw=radians(2.3), pitch=radians(14), roll=radians(1.2), x=0.074, y=-0.011, z=0.213),
    )


def random_robot(name: str, rng: np.random.Generator, image_size: tuple[int, int] = VGA) -> Robot:
    """Return a robot drawn at random: small to middling, its camera looking ahead, to a side or backwards.

    The camera is tilted so that something 0.6 m away and 0.1 m high is somewhere near the middle of its image.
    """
    width, height = image_size
    r = float(np.exp(rng.uniform(np.log(0.02), np.log(0.045))))
    f = max(width, height * 4 / 3) * rng.uniform(0.72, 1.15)
    z = rng.uniform(0.07, 0.28)
    side = float(rng.choice([0.0, radians(90), radians(-90), radians(180)], p=[0.7, 0.1, 0.1, 0.1]))
    return Robot(
        name=name,
        camera=CameraModel(
            fu=f,
            fv=f * rng.uniform(0.99, 1.01),
            cu=(width - 1) / 2 + width * rng.uniform(-0.03, 0.03),
            cv=(height - 1) / 2 + height * rng.uniform(-0.03, 0.03),
            kr=rng.uniform(-0.25, 0.03),
        ),
        image_size=(width, height),
        rR=r * rng.uniform(0.99, 1.01),
        rL=r * rng.uniform(0.99, 1.01),
        b=r * rng.uniform(3.6, 5.2),
        T_body_cam=mount(
            yaw=side + radians(rng.uniform(-12, 12)),
            pitch=atan2(z - 0.1, 0.6) + radians(rng.uniform(-4, 4)),
            roll=radians(rng.uniform(-5, 5)),
            x=rng.uniform(0.0, 0.08) * np.cos(side),
            y=rng.uniform(0.0, 0.06) * np.sin(side) + rng.uniform(-0.015, 0.015),
            z=z,
        ),
    )


def with_camera(robot: Robot, kind: CameraKind, rng: np.random.Generator) -> Robot:
    """Return the robot with a camera of a kind: its own, with more coefficients drawn, or a fisheye of some 150 deg.

    The coefficients are of the size that calibrations of webcams and of small fisheyes find.
    """
    if kind is CameraKind.RADIAL:
        return robot
    camera = robot.camera
    if kind is CameraKind.FISHEYE:
        f = 0.36 * max(robot.image_size) * rng.uniform(0.97, 1.03)
        k = (rng.uniform(0.0, 0.04), rng.uniform(-0.015, 0.0), rng.uniform(0.0, 0.005), rng.uniform(-1e-3, 0.0))
        values = np.array([f, f * rng.uniform(0.995, 1.005), camera.cu, camera.cv, *k])
        return replace(robot, camera=CameraModel.from_values(kind, values))
    k2, p1, p2, k3 = 0.3 * camera.kr**2 + rng.normal(0, 0.02), *rng.normal(0, 6e-4, 2), rng.normal(0, 0.005)
    if kind is CameraKind.BROWN:
        return replace(robot, camera=replace(camera, kind=kind, k2=k2, p1=p1, p2=p2, k3=k3))
    # numerator and denominator share a factor, as fitted rational models nearly do, so that nothing else changes much
    a = rng.uniform(0.1, 0.4)
    return replace(
        robot,
        camera=replace(
            camera,
            kind=kind,
            kr=camera.kr + a,
            k2=k2 + a * camera.kr,
            p1=p1,
            p2=p2,
            k3=k3 + a * k2,
            k4=a,
            k5=0.0,
            k6=0.0,
        ),
    )
