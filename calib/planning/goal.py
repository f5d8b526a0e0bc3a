"""Goals of a calibration: standard deviations on the ground and of the camera that a user cares about."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import inf, pi, radians

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.known_robot import KnownRobot
from boxcal.calib.geometry.parameters import ORDER, TRANSLATION
from boxcal.calib.geometry.so3_se3 import hat
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.uncertainty.projection import points_at
from boxcal.calib.uncertainty.propagation import STRAIGHT_M
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import project_with_jacobians

PROJECTION_M = 1.0
"""Distance of the points whose image shows how good camera and extrinsics are together, m."""
_GRID = (8, 6)
_SEEN = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Standard deviations to reach; the defaults are what the verdict calls good.

    Attributes
    ----------
    straight : m
        Position after 10 m straight ahead.
    heading : rad
        Heading after 10 m straight ahead.
    turn : rad
        Heading after a whole turn on the spot.
    camera : rad
        Direction of the camera, about its worst axis.
    place : m
        Place of the camera on the robot, along its worst axis.
    projection : px
        Image of a point 1 m from the camera that is known in the body's frame, over an image of 640 px.
    """

    straight: float = 0.20
    heading: float = radians(2.0)
    turn: float = radians(1.0)
    camera: float = radians(0.2)
    place: float = 0.005
    projection: float = 2.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 < value < inf:
                raise CalibError(f"goal {field.name} is {value}", needed="a positive number")


LABELS = {
    "straight": ("Position after 10 m straight ahead", "m"),
    "heading": ("Heading after 10 m straight ahead", "rad"),
    "turn": ("Heading after a whole turn", "rad"),
    "camera": ("Direction of the camera", "rad"),
    "place": ("Place of the camera", "m"),
    "projection": ("Image of a point 1 m away", "px"),
}
"""Names of the quantities, in words, and their units."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One quantity that a user cares about, beside its goal.

    Attributes
    ----------
    name, label, unit
        Name as in :class:`Goal`, in words, and the unit of both quantities: m, rad or px.
    value
        Standard deviation; infinite where it is undetermined.
    goal
        What is wanted.
    """

    name: str
    label: str
    unit: str
    value: float
    goal: float

    @property
    def ratio(self) -> float:
        """The quantity over its goal: 1 and less is enough."""
        return self.value / self.goal

    @property
    def reached(self) -> bool:
        """Whether the goal is reached."""
        return self.value <= self.goal


def worst(bars: Sequence[Bar]) -> Bar:
    """Return the bar that is furthest from its goal."""
    return max(bars, key=lambda bar: bar.ratio)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quantities:
    """The quantities of :class:`Goal` as linear functions of the shared unknowns.

    Attributes
    ----------
    rows : (K, n)
        Change of each linear function by the unknowns, in the order and terms of the covariance that it is meant for.
    spans
        The rows of each quantity, in the order of ``Goal``.
    goals : (6,)
        Goals of the quantities.
    """

    rows: Array
    spans: tuple[slice, ...]
    goals: Array

    def from_variances(self, variance: Array) -> Array:
        """Return the quantities' standard deviations, (..., 6), from the rows' variances (..., K).

        Position and image are roots of the sum over both coordinates; direction and place are those of the worst axis.
        """
        parts = [variance[..., span] for span in self.spans]
        squares = [
            part.max(axis=-1) if name in _WORST_AXIS else part.sum(axis=-1)
            for name, part in zip(LABELS, parts, strict=True)
        ]
        return np.asarray(np.sqrt(np.stack(squares, axis=-1)))

    def bars(self, cov: Array) -> tuple[Bar, ...]:
        """Return the bars of a covariance (n, n); a quantity that hangs on what is not determined is infinite."""
        unknown = ~np.isfinite(np.diag(cov))
        finite = np.where(unknown[:, None] | unknown, 0.0, cov)
        variance = np.einsum("ki,ij,kj->k", self.rows, finite, self.rows)
        open_ = np.any(np.abs(self.rows[:, unknown]) > _SEEN, axis=1)
        return self.as_bars(self.from_variances(np.where(open_, inf, np.maximum(variance, 0.0))))

    def as_bars(self, values: Array) -> tuple[Bar, ...]:
        """Return bars of the quantities' values (6,)."""
        return tuple(
            Bar(name=name, label=label, unit=unit, value=float(value), goal=float(goal))
            for (name, (label, unit)), value, goal in zip(LABELS.items(), values, self.goals, strict=True)
        )


_WORST_AXIS = ("camera", "place")


def quantities(
    names: Sequence[str],
    robot: KnownRobot,
    image_size: tuple[int, int],
    goal: Goal,
) -> Quantities:
    """Return the quantities by the shared unknowns, the extrinsics' translation along the body's axes.

    Parameters
    ----------
    names : n
        The shared unknowns, the 14 reported ones first.
    robot
        Camera, wheels and extrinsics.
    image_size : px
    goal
        Goals; that of the image is taken in proportion to its width.
    """
    rR, rL, b = robot.rR, robot.rL, robot.b
    n, at = len(names), {name: k for k, name in enumerate(names)}
    right, left, apart = at["rR"], at["rL"], at["b"]
    straight = np.zeros((2, n))
    straight[0, [right, left]] = STRAIGHT_M / 2 / rR, STRAIGHT_M / 2 / rL
    heading = np.zeros((1, n))
    heading[0, [right, left]] = STRAIGHT_M / b / rR, -STRAIGHT_M / b / rL
    straight[1] = heading[0] * STRAIGHT_M / 2
    turn = np.zeros((1, n))
    turn[0, [right, left, apart]] = pi / rR, pi / rL, -2 * pi / b
    angle, place = np.zeros((3, n)), np.zeros((3, n))
    angle[:, [at[a] for a in ("rx", "ry", "rz")]] = np.eye(3)
    place[:, TRANSLATION] = np.eye(3)
    parts = [straight, heading, turn, angle, place, _projection(at, n, robot, image_size)]
    ends = np.cumsum([len(part) for part in parts])
    goals = np.array([getattr(goal, name) for name in LABELS])
    goals[-1] *= image_size[0] / 640
    return Quantities(
        rows=np.concatenate(parts),
        spans=tuple(slice(int(e) - len(part), int(e)) for e, part in zip(ends, parts, strict=True)),
        goals=goals,
    )


def _projection(at: dict[str, int], n: int, robot: KnownRobot, image_size: tuple[int, int]) -> Array:
    """Return linear functions whose variances add up to the image's mean variance over a grid of pixels."""
    camera, R_body_cam = robot.camera, robot.T_body_cam[:3, :3]
    u, v = np.meshgrid(np.linspace(0, image_size[0] - 1, _GRID[0]), np.linspace(0, image_size[1] - 1, _GRID[1]))
    p_cam = points_at(camera, np.stack([u.ravel(), v.ravel()], axis=1), PROJECTION_M)
    p_cam = p_cam[np.all(np.isfinite(p_cam), axis=1)]
    _, J_lens, J_point = project_with_jacobians(camera.kind, camera.values, p_cam)
    J = np.concatenate([J_lens, J_point @ hat(p_cam), -J_point @ R_body_cam.T], axis=2)
    columns = [*(at[k] for k in ("fu", "fv", "cu", "cv", *camera.names)), *(at[k] for k in ORDER[8:])]
    flat = J.reshape(-1, J.shape[2]) / np.sqrt(len(p_cam))
    rows = np.zeros((min(flat.shape), n))
    rows[:, columns] = np.linalg.qr(flat, mode="r")
    return rows


def along_camera(found: Quantities, R_body_cam: Array) -> Quantities:
    """Return quantities that take the extrinsics' translation along the camera's axes, as the solver has it."""
    rows = found.rows.copy()
    rows[:, TRANSLATION] = rows[:, TRANSLATION] @ R_body_cam
    return replace(found, rows=rows)


def bars_of_estimate(
    estimate: Estimate, goal: Goal | None = None, image_size: tuple[int, int] = (640, 480)
) -> tuple[Bar, ...]:
    """Return what a user cares about of an estimate, beside the goals."""
    found = quantities(estimate.names, estimate, image_size, goal or Goal())
    cov = estimate.cov_all
    if estimate.odometry_cov is not None:
        cov = cov.copy()
        cov[5:8, 5:8] = estimate.odometry_cov[5:8, 5:8]
    return found.bars(cov)


def bars_of_calibration(calibration: Calibration, goal: Goal | None = None) -> tuple[Bar, ...]:
    """Return what a user cares about of a calibration, beside the goals; nothing for the closed form alone."""
    detail, goal = calibration.detail, goal or Goal()
    if detail is None:
        return ()
    sigma, ground = detail.covariance.sigma, detail.ground
    values = {
        "straight": ground.straight_position,
        "heading": ground.straight_heading,
        "turn": ground.turn_heading,
        "camera": max(sigma[name] for name in ("rx", "ry", "rz")),
        "place": max(sigma[name] for name in ("tx", "ty", "tz")),
        "projection": ground.projection_mean_px,
    }
    goals = {name: getattr(goal, name) for name in LABELS}
    goals["projection"] *= calibration.image_size[0] / 640
    return tuple(
        Bar(name=name, label=label, unit=unit, value=float(values[name]), goal=float(goals[name]))
        for name, (label, unit) in LABELS.items()
    )
