"""General solvers on the likelihood that the estimator maximises: the same residuals, noise levels and start.

Every unknown moves by addition here, the extrinsics' rotation as a rotation vector: what solvers can do by themselves.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.geometry.parameters import CAMERA, MOUNTING, WHEELS
from boxcal.calib.geometry.so3_se3 import exp_so3, log_so3, right_jacobian, rigid
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.corner_residuals import Corners, corner_residuals
from boxcal.calib.likelihood.estimator import fit, step_of
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.initial_guess import camera_start, first_states
from boxcal.calib.likelihood.leg_residuals import LegResiduals, leg_covariance, leg_residuals
from boxcal.calib.likelihood.problem import PER_STOP, Problem, build_problem
from boxcal.calib.likelihood.state import POSE, READINGS, State
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

LEAN = 3
"""Roll, pitch and height: a stop's unknowns beside its pose and encoder errors."""
OF_STOP = PER_STOP + LEAN
LOCAL = slice(PER_STOP, OF_STOP)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a solver found.

    Attributes
    ----------
    seconds
        Processor time.
    evaluations
        How often it took the residuals.
    wheels : (3,), m
        rR, rL, b.
    """

    seconds: float
    evaluations: int
    wheels: Array


class Peer:
    """The likelihood of one drive at given noise levels, as whitened residuals of the shared and the stops' unknowns.

    The legs are whitened at the estimator's solution. Unknowns are changes since the start: (n,) shared and (P, 8).
    """

    def __init__(self, data: Correspondences, start: FourSteps) -> None:
        options = EstimateOptions()
        self.done = fit([data], start, options)
        cameras = camera_start([data], start)
        self.problem: Problem = build_problem([data], cameras.kept, options, step_of([data], options))
        self.start = first_states(self.problem, [data], cameras)[0]
        self.w0 = log_so3(self.start.T_body_cam[:3, :3])
        legs = leg_residuals(self.problem, self.done.state, Columns())
        levels = self.done.components
        cov = leg_covariance(self.problem, legs.model, np.array(levels.slip))
        self.whiten = np.linalg.inv(np.linalg.cholesky(cov))
        self.noise = levels.noise_scale
        self.lean = levels.local_sigma[:LEAN]
        self.tilt = self.problem.prior[self.problem.tilts]
        self.n, self.P = len(self.problem.names), len(self.problem.drive)

    def state(self, shared: Array, stops: Array) -> State:
        """Return the state after changes (n,) and (P, 8)."""
        start = self.start
        R, t = exp_so3(self.w0 + shared[MOUNTING][:3]), start.T_body_cam[:3, 3] + shared[MOUNTING][3:]
        return replace(
            start,
            lens=start.lens + shared[CAMERA],
            wheels=start.wheels + shared[WHEELS],
            T_body_cam=rigid(R, t),
            tilt=start.tilt + shared[self.problem.tilts].reshape(-1, 2),
            poses=start.poses + stops[:, POSE],
            encoder_errors=start.encoder_errors + stops[:, READINGS],
            lean=start.lean + stops[:, LOCAL],
        )

    def corners(self, state: State) -> Corners:
        """Return residuals and derivatives of the corners at a state, noise scale 1."""
        return corner_residuals(self.problem, state, Columns())

    def legs(self, state: State) -> LegResiduals:
        """Return residuals and derivatives of the legs at a state, not whitened."""
        return leg_residuals(self.problem, state, Columns())

    def added(self, J: Array, shared: Array) -> Array:
        """Return derivatives by the shared unknowns (..., n) as they are added here: turns of a rotation vector."""
        out = J.copy()
        w = self.w0 + shared[MOUNTING][:3]
        turn, move = J[..., MOUNTING][..., :3], J[..., MOUNTING][..., 3:]
        out[..., MOUNTING] = np.concatenate([turn @ right_jacobian(w), move @ exp_so3(w).T], axis=-1)
        return out


def through_scipy(data: Correspondences, start: FourSteps) -> Answer:
    """Return what ``scipy.optimize.least_squares`` finds with numeric derivatives."""
    peer = Peer(data, start)
    n, P = peer.n, peer.P
    begin = time.process_time()

    def residuals(x: Array) -> Array:
        state = peer.state(x[:n], x[n:].reshape(P, OF_STOP))
        legs = peer.whiten @ peer.legs(state).residual[:, :, None]
        corners = peer.corners(state).residual / peer.noise
        own = [(state.lean / peer.lean).ravel(), state.encoder_errors.ravel(), state.tilt.ravel() / peer.tilt]
        return np.concatenate([corners.ravel(), legs.ravel(), *own])

    found = least_squares(residuals, np.zeros(n + OF_STOP * P), method="trf", x_scale="jac")
    seconds = time.process_time() - begin
    evaluations = found.nfev + found.njev * (n + OF_STOP * P)
    return Answer(seconds=seconds, evaluations=evaluations, wheels=peer.start.wheels + found.x[WHEELS])


def through_gtsam(data: Correspondences, start: FourSteps) -> Answer:
    """Return what GTSAM's Levenberg-Marquardt finds on a graph of a factor a stop and a leg, with our derivatives.

    All factors share one evaluation of residuals and derivatives a step, as ours do.

    Raises
    ------
    ImportError
        Without the extra ``bench``.
    """
    import gtsam  # noqa: PLC0415 - of the extra

    peer = Peer(data, start)
    begin = time.process_time()
    graph = Graph(peer, gtsam)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-9)
    found = gtsam.LevenbergMarquardtOptimizer(graph.graph, graph.start(), parameters).optimize()
    gtsam.Marginals(graph.graph, found).marginalCovariance(graph.shared)  # which ours gives, too
    wheels = peer.start.wheels + found.atVector(graph.shared)[WHEELS]
    return Answer(seconds=time.process_time() - begin, evaluations=graph.evaluations, wheels=wheels)


class Graph:
    """The likelihood as a factor graph: corners of a stop, legs, priors of the floor's tilt and of each stop."""

    def __init__(self, peer: Peer, gtsam: Any) -> None:
        self.peer, self.gtsam, self.evaluations = peer, gtsam, 0
        self.shared = gtsam.symbol("s", 0)
        self.stops = [gtsam.symbol("p", k) for k in range(peer.P)]
        self._at, self._known = None, None
        self.graph = gtsam.NonlinearFactorGraph()
        starts, problem = peer.problem.corner_starts, peer.problem
        for k, key in enumerate(self.stops):
            rows = slice(int(starts[k]), int(starts[k + 1]))
            self._add(2 * (rows.stop - rows.start), [self.shared, key], partial(self._corners, rows))
            sigma = np.concatenate([np.ones(2), peer.lean])
            first = np.concatenate([peer.start.encoder_errors[k], peer.start.lean[k]])
            self._add(5, [key], partial(self._own, k, sigma, first))
        for leg, stop in enumerate(problem.leg_stop):
            keys = [self.shared, self.stops[stop], self.stops[stop + 1]]
            self._add(3, keys, partial(self._leg, leg))
        self._add(len(peer.tilt), [self.shared], self._tilts)

    def start(self) -> Any:
        """Return all changes at zero."""
        values = self.gtsam.Values()
        values.insert(self.shared, np.zeros(self.peer.n))
        for key in self.stops:
            values.insert(key, np.zeros(OF_STOP))
        return values

    def _add(self, size: int, keys: list[int], terms: Callable[[], tuple[Array, list[Array]]]) -> None:
        def error(_: object, values: Any, jacobians: list[Array] | None) -> Array:
            self._linearize(values)
            residual, parts = terms()
            if jacobians is not None:
                for k, part in enumerate(parts):
                    jacobians[k] = np.asfortranarray(part)
            return residual

        self.graph.add(self.gtsam.CustomFactor(self.gtsam.noiseModel.Unit.Create(size), keys, error))

    def _linearize(self, values: Any) -> None:
        """Take residuals and derivatives of all data, unless they are of these values."""
        at = np.concatenate([values.atVector(key) for key in (self.shared, *self.stops)])
        if self._at is not None and np.array_equal(at, self._at):
            return
        self.evaluations += 1
        peer, n = self.peer, self.peer.n
        shared, stops = at[:n], at[n:].reshape(peer.P, OF_STOP)
        state = peer.state(shared, stops)
        corners, legs = peer.corners(state), peer.legs(state)
        of_shared = peer.added(corners.J_shared, shared)
        own = np.concatenate(
            [corners.J_pose, np.zeros((*corners.J_pose.shape[:2], 2)), corners.J_local[:, :, :LEAN]], 2
        )
        group = corners.group
        by_corner = [corners.jacobian @ part[group] / peer.noise for part in (of_shared, own)]
        J = peer.whiten @ legs.jacobian
        residual = (peer.whiten @ legs.residual[:, :, None])[:, :, 0]
        self._at = at
        self._known = (shared, stops, -corners.residual / peer.noise, by_corner, -residual, J)

    def _corners(self, rows: slice) -> tuple[Array, list[Array]]:
        _, _, residual, parts, _, _ = self._known
        return residual[rows].ravel(), [part[rows].reshape(-1, part.shape[2]) for part in parts]

    def _leg(self, leg: int) -> tuple[Array, list[Array]]:
        *_, residual, J = self._known
        by_shared, first, second = np.zeros((3, self.peer.n)), np.zeros((3, OF_STOP)), np.zeros((3, OF_STOP))
        by_shared[:, WHEELS] = J[leg, :, :3]
        first[:, :PER_STOP], second[:, :PER_STOP] = J[leg, :, 3 : 3 + PER_STOP], J[leg, :, 3 + PER_STOP :]
        return residual[leg], [by_shared, first, second]

    def _own(self, stop: int, sigma: Array, first: Array) -> tuple[Array, list[Array]]:
        J = np.zeros((5, OF_STOP))
        J[:2, READINGS], J[2:, LOCAL] = np.eye(2), np.diag(1 / sigma[2:])
        return (first + self._known[1][stop][3:]) / sigma, [J]

    def _tilts(self) -> tuple[Array, list[Array]]:
        peer, tilts = self.peer, self.peer.problem.tilts
        J = np.zeros((len(peer.tilt), peer.n))
        J[:, tilts] = np.diag(1 / peer.tilt)
        return (peer.start.tilt.ravel() + self._known[0][tilts]) / peer.tilt, [J]
