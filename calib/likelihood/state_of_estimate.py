"""The solver's unknowns back from an estimate, to start from where the answer is near by."""

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_so3
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.problem import Problem
from boxcal.calib.likelihood.state import State, resting
from boxcal.target.arrays import Array


def state_of(problem: Problem, found: Estimate) -> State:
    """Return an estimate as a state of a problem, of some of its stops; lean and encoder errors begin at zero.

    Parameters
    ----------
    problem
        With the estimate's camera model; unknowns that the estimate has not begin at zero.
    found
        The estimate.
    """
    value = dict(zip(found.names, found.values.tolist(), strict=True))
    rows = [found.drives[d].stops.index(int(j)) for d, j in zip(problem.drive, problem.stop, strict=True)]
    at_stops = np.array([found.drives[d].T_box_body[row] for d, row in zip(problem.drive, rows, strict=True)])
    tilt = np.array([drive.tilt for drive in found.drives])
    floor = exp_so3(np.concatenate([tilt, np.zeros((len(tilt), 1))], axis=1))[problem.drive]
    T = np.swapaxes(floor, 1, 2) @ at_stops[:, :3]  # T_floor_body
    poses = np.stack([T[:, 0, 3], T[:, 1, 3], np.arctan2(T[:, 1, 0], T[:, 0, 0])], axis=1)
    state = resting(
        problem,
        lens=found.camera.values,
        wheels=np.array([found.rR, found.rL, found.b]),
        T_body_cam=found.T_body_cam,
        poses=poses,
    )

    def values(columns: slice) -> Array:
        return np.array([value.get(name, 0.0) for name in problem.names[columns]])

    state.tilt[:] = tilt if problem.tilt_count else 0.0
    state.shape[:] = values(problem.shapes)
    state.explained[:] = values(problem.explained)
    return state
