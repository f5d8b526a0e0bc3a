"""Likelihood of a robot with several cameras about one state: corners of each among all unknowns, and the legs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.cameras.problem import BODY, Part, Together
from boxcal.calib.likelihood.cameras.state import RobotState
from boxcal.calib.likelihood.components import VarianceComponents
from boxcal.calib.likelihood.corner_residuals import Corners, corner_equations, corner_residuals
from boxcal.calib.likelihood.explanation import Columns, stacked
from boxcal.calib.likelihood.leg_residuals import leg_residuals
from boxcal.calib.likelihood.levenberg_marquardt import Linearization
from boxcal.calib.likelihood.moving.rolling import with_rolling
from boxcal.calib.likelihood.moving.slip_within import equations_with_slip, slip_modes
from boxcal.calib.likelihood.normal_equations import Local, Normal
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levels(VarianceComponents):
    """Variance components of several cameras. The noise scale is 1: each camera's own is in its equations.

    Attributes
    ----------
    scales : (C,)
        Noise scale of each camera.
    """

    scales: tuple[float, ...]

    @property
    def local_sigma(self) -> Array:
        """Standard deviations of a stop's local unknowns, (3 + C,)."""
        return np.array([self.lean, self.lean, self.height, *(self.growth for _ in self.scales)])

    def of(self, number: int) -> "Levels":
        """Return the components with the noise scale of one camera, numbered from 0."""
        return replace(self, noise_scale=self.scales[number])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraEquations:
    """One camera's corners about a state, for noise scale 1.

    Attributes
    ----------
    corners
        Residuals and derivatives, by all unknowns of the robot.
    normal, local, squares
        Their normal equations, those of the local unknowns, and each stop's sum of squares (P,).
    """

    corners: Corners
    normal: Normal
    local: Local
    squares: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class About:
    """The likelihood about one state.

    Attributes
    ----------
    state
        Where.
    cameras
        Of each camera.
    at
        Of all, with the noise scales that it was made for.
    """

    state: RobotState
    cameras: tuple[CameraEquations, ...]
    at: Linearization

    @property
    def valid(self) -> bool:
        """Whether all landmarks lie in front of their cameras."""
        return all(camera.corners.valid for camera in self.cameras)

    def of(self, number: int) -> Linearization:
        """Return the likelihood with one camera's corners alone, numbered from 0, for noise scale 1."""
        own = self.cameras[number]
        return replace(
            self.at, corners=own.corners, corner_normal=own.normal, corner_local=own.local, corner_squares=own.squares
        )


def about(robot: Together, state: RobotState, scales: Sequence[float]) -> About:
    """Return the likelihood about a state, for noise scales (C,) of the cameras."""
    cameras = tuple(_camera(robot, part, state.of(part, c), c) for c, part in enumerate(robot.parts))
    chain = state.chain(robot)
    columns = _columns(robot.problem, chain, robot.others)
    legs = leg_residuals(robot.problem, chain, columns)
    if not legs.J_explained.shape[2] and robot.others:
        legs = replace(legs, J_explained=np.zeros((*legs.residual.shape, robot.others)))
    normal, local, squares = _summed(cameras, scales)
    at = Linearization(
        state=chain,
        columns=columns,
        corners=cameras[0].corners,
        corner_normal=normal,
        corner_local=local,
        corner_squares=squares,
        legs=legs,
    )
    return About(state=state, cameras=cameras, at=at)


def rescaled(found: About, scales: Sequence[float]) -> About:
    """Return the likelihood about the same state for other noise scales (C,)."""
    normal, local, squares = _summed(found.cameras, scales)
    return replace(found, at=replace(found.at, corner_normal=normal, corner_local=local, corner_squares=squares))


def _camera(robot: Together, part: Part, state: State, number: int) -> CameraEquations:
    own = corner_residuals(part.problem, state, Columns(), spare=0 if part.course is None else 1)
    if part.course is None:
        corners = _among_all(robot, part, own, number)
        equations = corner_equations(robot.problem, corners, part.corners)
    else:
        frames = (part.course, part.height)
        own = with_rolling(part.problem, state, own, *frames)
        modes = slip_modes(part.problem, state, own, frames, part.within)
        corners = _among_all(robot, part, own, number)
        corners, equations, _ = equations_with_slip(robot.problem, corners, part.corners, modes)
    normal, local, squares = equations
    return CameraEquations(corners=corners, normal=normal, local=local, squares=squares)


def _among_all(robot: Together, part: Part, own: Corners, number: int) -> Corners:
    """Return a camera's corners with the derivatives by all unknowns, at the places of its stops among all."""
    G, m = own.J_shared.shape[:2]
    shared = np.zeros((G, m, len(robot.problem.names)))
    shared[:, :, part.columns] = own.J_shared
    local = np.zeros((G, m, BODY + len(robot.parts)))
    local[:, :, :BODY], local[:, :, BODY + number] = own.J_local[:, :, :BODY], own.J_local[:, :, BODY]
    return replace(own, group_stop=part.places[own.group_stop], J_shared=shared, J_local=local)


def _columns(problem: Problem, state: State, others: int) -> Columns:
    """Return the columns of the explanations, with those of the other cameras' unknowns, which move no leg."""
    if not problem.explanations:
        return Columns()
    found = stacked(problem.explanations, problem, state)

    def wider(part: Array | None) -> Array | None:
        return None if part is None else np.concatenate([part, np.zeros((*part.shape[:-1], others))], axis=-1)

    return Columns(travel=wider(found.travel), legs=wider(found.legs))


def _summed(cameras: Sequence[CameraEquations], scales: Sequence[float]) -> tuple[Normal, Local, Array]:
    """Return the equations of all cameras' corners, each weighted by its noise scale."""
    w = [scale**-2 for scale in scales]

    def total(parts: Sequence[Array]) -> Array:
        return np.asarray(sum(weight * part for weight, part in zip(w, parts, strict=True)))

    normals, locals_ = [c.normal for c in cameras], [c.local for c in cameras]
    normal = Normal(
        A=total([n.A for n in normals]),
        B=total([n.B for n in normals]),
        D=total([n.D for n in normals]),
        E=normals[0].E,
        a=total([n.a for n in normals]),
        c=total([n.c for n in normals]),
    )
    local = Local(
        D=total([x.D for x in locals_]),
        by_shared=total([x.by_shared for x in locals_]),
        by_chain=total([x.by_chain for x in locals_]),
        c=total([x.c for x in locals_]),
    )
    return normal, local, total([c.squares for c in cameras])
