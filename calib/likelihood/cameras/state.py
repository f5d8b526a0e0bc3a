"""Values of all unknowns of a robot with several cameras, and how a step changes them."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.parameters import CAMERA, MOUNTING
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid, rot_z
from boxcal.calib.likelihood.cameras.problem import BODY, Part, Together
from boxcal.calib.likelihood.state import State, retract
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mounted:
    """One camera: its coefficients, its extrinsics and the growth of the tags' black in its images.

    Attributes
    ----------
    lens : (5 + extras,)
    T_body_cam : (4, 4), m
    common_growth : px
    growth : (P,), px
        At each stop, besides.
    """

    lens: Array
    T_body_cam: Array
    common_growth: float
    growth: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotState:
    """Values of all unknowns of a robot with several cameras.

    Attributes
    ----------
    body
        Wheels, floor, box and stops, with the first camera.
    cameras
        All cameras.
    """

    body: State
    cameras: tuple[Mounted, ...]

    def of(self, part: Part, number: int) -> State:
        """Return the state of one camera's problem; ``number`` from 0."""
        own, body, rows = self.cameras[number], self.body, part.places
        return replace(
            body,
            lens=own.lens,
            T_body_cam=own.T_body_cam,
            common_growth=own.common_growth,
            explained=np.zeros(0) if part.course is None else body.explained[[part.readout]],
            poses=body.poses[rows],
            lean=body.lean[rows],
            growth=own.growth[rows],
            encoder_errors=body.encoder_errors[rows],
        )

    def chain(self, all_of_it: Together) -> State:
        """Return the state of the chain's problem: growth (P, C) of all cameras, and the other cameras' priors' values.

        What has no prior stands as zero.
        """
        causes = self.body.explained[: all_of_it.causes]
        rest = [np.zeros(0)]
        for part, own in zip(all_of_it.parts[1:], self.cameras[1:], strict=True):
            growth = part.problem.growth
            values = np.zeros(len(own.lens) + 6 + growth.stop - growth.start)
            values[len(own.lens) + 6 :] = own.common_growth
            rest.append(values)
        growth_px = np.stack([own.growth for own in self.cameras], axis=1)
        return replace(self.body, explained=np.concatenate([causes, *rest]), growth=growth_px)


def stepped(all_of_it: Together, state: RobotState, d_shared: Array, d_stops: Array, d_local: Array) -> RobotState:
    """Return the state after a step of the shared unknowns (n,), the chain (P, 5) and the local unknowns (P, 3 + C).

    The poses follow the first camera, as in :func:`boxcal.calib.likelihood.state.retract`.
    """
    problem, P = all_of_it.problem, len(d_stops)
    begin = replace(state.chain(all_of_it), growth=np.zeros(P))
    body = retract(problem, begin, d_shared, d_stops, np.column_stack([d_local[:, :BODY], np.zeros(P)]))
    cameras = [
        _camera(part, own, d_shared[part.columns], d_local[:, BODY + c])
        for c, (part, own) in enumerate(zip(all_of_it.parts, state.cameras, strict=True))
    ]
    first = replace(cameras[0], lens=body.lens, T_body_cam=body.T_body_cam)
    return RobotState(body=body, cameras=(first, *cameras[1:]))


def _camera(part: Part, own: Mounted, d: Array, d_growth: Array) -> Mounted:
    """Return one camera after a step (n_c,) of its problem's shared unknowns."""
    m, R = d[MOUNTING], own.T_body_cam[:3, :3]
    yaw = float(R[2] @ m[:3])
    turned = rot_z(yaw) @ R @ exp_so3(m[:3] - yaw * R[2])
    return Mounted(
        lens=own.lens + np.concatenate([d[CAMERA], d[part.problem.extras]]),
        T_body_cam=rigid(turned, own.T_body_cam[:3, 3] + R @ m[3:]),
        common_growth=own.common_growth + float(d[part.problem.growth].sum()),
        growth=own.growth + d_growth,
    )
