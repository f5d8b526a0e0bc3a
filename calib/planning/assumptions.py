"""Assumptions on noise, floor and box where no drive has measured them yet."""

from dataclasses import dataclass, field
from math import radians

import numpy as np

from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.target_deformation import HAND_MADE
from boxcal.calib.likelihood.variance_components import USUAL
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array
from boxcal.target.box import Target


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Noise of a drive that is planned; what :mod:`boxcal.calib.likelihood` finds in drives that were driven.

    Attributes
    ----------
    corner_px : px
        Standard deviation of a corner's coordinate at a stop.
    slip : m/sqrt(m)
        Of each wheel.
    encoder_step : rad
        0 for encoders without steps.
    lean, height, growth : rad, m, px
        From stop to stop: roll and pitch, height, growth of the tags' black.
    target
        How well the box was made, by variance component.
    min_side_px : px
        Shortest side of a tag that is read reliably.
    joint_rate_hz : Hz
        Wheel samples a second.
    max_speed : m/s
        Of a wheel's rim.
    stand_s : s
        Time at a stop.
    """

    corner_px: float = 0.05
    slip: float = 5e-4
    encoder_step: float = field(default=radians(0.1302))
    lean: float = USUAL["lean"]
    height: float = USUAL["height"]
    growth: float = USUAL["growth"]
    target: tuple[tuple[str, float], ...] = tuple(HAND_MADE.items())
    min_side_px: float = 16.0
    joint_rate_hz: float = 50.0
    max_speed: float = 0.3
    stand_s: float = 2.0

    @property
    def said(self) -> str:
        """Noise that a plan's promises rest on, in words."""
        return f"wheels that slip {self.slip * 1e3:g} mm after 1 m and corners to {self.corner_px:g} px"

    @property
    def components(self) -> VarianceComponents:
        """The same as variance components, where corners come with their own covariance."""
        return VarianceComponents(
            noise_scale=1.0,
            slip=self.slip,
            lean=self.lean,
            height=self.height,
            growth=self.growth,
            target=dict(self.target),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """All that predictions of one robot's stops and legs need.

    Attributes
    ----------
    robot
        Camera, wheels and extrinsics as far as they are known.
    target
        The box.
    assumptions
        Noise.
    components
        Variance components: what was found, or what is assumed.
    options
        Which unknowns there are; its camera model is that of the robot.
    """

    robot: Robot
    target: Target
    assumptions: Assumptions
    components: VarianceComponents
    options: EstimateOptions


def assumed_model(
    robot: Robot,
    target: Target,
    assumptions: Assumptions | None = None,
    options: EstimateOptions | None = None,
) -> Model:
    """Return the model of a robot whose drives are not yet driven."""
    given = assumptions or Assumptions()
    options = options or EstimateOptions(lens=robot.camera.kind, target=target)
    return Model(robot=robot, target=target, assumptions=given, components=given.components, options=options)


_VAGUE = {
    **dict.fromkeys(("fu", "fv", "cu", "cv"), 0.3),
    **dict.fromkeys(("rR", "rL", "b"), 0.3),
    **dict.fromkeys(("rx", "ry", "rz"), 0.5),
    **dict.fromkeys(("tx", "ty", "tz"), 0.3),
    **dict.fromkeys(("p1", "p2"), 0.1),
}
_VAGUE_COEFFICIENT = 1.0


def vague_sigma(names: tuple[str, ...], robot: Robot) -> Array:
    """Return standard deviations (n,) so large that they only keep a first stop's equations solvable; infinite if none.

    Of lengths and of the camera they are fractions of the values.
    """
    scale = {
        **dict.fromkeys(("fu", "fv", "cu", "cv"), (abs(robot.camera.fu) + abs(robot.camera.fv)) / 2),
        "rR": robot.rR,
        "rL": robot.rL,
        "b": robot.b,
    }
    known = {"fu", "fv", "cu", "cv", *robot.camera.names, "rR", "rL", "b", "rx", "ry", "rz", "tx", "ty", "tz"}
    return np.array(
        [_VAGUE.get(name, _VAGUE_COEFFICIENT) * scale.get(name, 1.0) if name in known else np.inf for name in names]
    )
