"""Time the estimator: against the closed form, against a general solver, and over the number of stops.

    python benchmarks/estimator_speed.py

The general solver is ``scipy.optimize.least_squares`` with numeric Jacobians on the same residuals (corners, legs,
priors; noise levels and left-out data given, which the estimator finds on top). Processor time,
best of several runs, in one thread.
"""

import argparse
import time
from collections.abc import Callable
from math import radians

import numpy as np
from scipy.optimize import least_squares

from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.four_steps.procedure import FourSteps, solve_four_steps
from boxcal.calib.likelihood import EstimateOptions, estimate
from boxcal.calib.likelihood.estimator import fit, step_of
from boxcal.calib.likelihood.explanation import Columns
from boxcal.calib.likelihood.initial_guess import camera_start, first_states
from boxcal.calib.likelihood.problem import LOCAL, PER_STOP, build_problem
from boxcal.calib.likelihood.residuals import corner_residuals, leg_covariance, leg_residuals
from boxcal.calib.likelihood.state import State, retract
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.correspondences import Correspondences
from boxcal.one_thread import one_thread
from boxcal.target.arrays import Array
from boxcal.target.box import make_target


def drive(stops: int) -> tuple[Correspondences, FourSteps]:
    rng = np.random.default_rng(stops)
    options = DriveOptions(stops=stops, slip=0.0003, encoder_step=radians(0.1302), steps_per_sample=4)
    driven = simulate_drive(khepera(), make_target(), options, rng)
    data = exact_correspondences(khepera(), make_target(), driven, 0.2, rng)
    return data, solve_four_steps(data)


def best(work: Callable[[], object], times: int) -> float:
    """Return the least processor time of several runs, s: what other work on the machine hardly changes."""
    seconds = []
    for _ in range(times):
        begin = time.process_time()
        work()
        seconds.append(time.process_time() - begin)
    return min(seconds)


def through_scipy(data: Correspondences, start: FourSteps) -> tuple[float, int, Array]:
    """Return the time, the evaluations and the wheels that a general solver finds for the same likelihood."""
    options = EstimateOptions()
    done = fit([data], start, options)
    begin = time.process_time()
    cameras = camera_start([data], start)
    problem = build_problem([data], cameras.kept, options, step_of([data], options))
    state = first_states(problem, [data], cameras)[0]
    legs = leg_residuals(problem, done.state, Columns())
    whiten = np.linalg.inv(np.linalg.cholesky(leg_covariance(problem, legs.model, np.array(done.components.slip))))
    n, P, own = len(problem.names), len(problem.drive), PER_STOP + LOCAL
    finite = np.isfinite(problem.prior)
    lean = done.components.local_sigma[:3]

    def at(x: Array) -> State:
        stops = x[n:].reshape(P, own)
        return retract(problem, state, x[:n], stops[:, :PER_STOP], stops[:, PER_STOP:])

    def residuals(x: Array) -> Array:
        here = at(x)
        legs = whiten @ leg_residuals(problem, here, Columns()).residual[:, :, None]
        value = here.tilt.ravel() / problem.prior[finite]
        corners = corner_residuals(problem, here, Columns()).residual / done.components.noise_scale
        own = [(here.lean / lean).ravel(), here.encoder_errors.ravel()]
        return np.concatenate([corners.ravel(), legs.ravel(), value, *own])

    found = least_squares(residuals, np.zeros(n + own * P), method="trf", x_scale="jac")
    seconds = time.process_time() - begin
    return (
        seconds,
        found.nfev + found.njev * (n + own * P),
        at(found.x).wheels,
    )


@one_thread()
def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--times", type=int, default=7, help="how often each is timed (7)")
    times = parser.parse_args().times
    data, start = drive(20)
    corners = sum(len(s.landmark_ids) for s in data.stops)
    print(f"20 stops, {corners} corners, {len(data.wheels)} wheel samples")
    closed = best(lambda: solve_four_steps(data), times)
    print(f"  the four closed-form steps                        {closed * 1e3:8.1f} ms")
    ours = best(lambda: estimate([data], start), times)
    print(f"  likelihood, levels, tests and covariance          {ours * 1e3:8.1f} ms")
    general, evaluations, wheels = through_scipy(data, start)
    print(
        f"  scipy, numeric Jacobians ({evaluations} evaluations)     {general * 1e3:8.1f} ms, "
        f"{general / ours:.0f} times as long"
    )
    found = estimate([data], start)
    off = np.max(np.abs(wheels - (found.rR, found.rL, found.b)) / [found.sigma[k] for k in ("rR", "rL", "b")])
    print(f"  largest difference of the two answers in rR, rL, b: {off:.3f} sigma")
    everything = EstimateOptions(lens=None, target=make_target())
    command = best(lambda: estimate_explained([data], start, everything), times)
    print(f"  the command's defaults: camera model, box and causes  {command * 1e3:8.1f} ms")
    for stops in (200, 500):
        data, start = drive(stops)
        closed = best(lambda data=data: solve_four_steps(data), 1)
        long = best(lambda data=data, start=start: estimate([data], start), max(times // 2, 1))
        print(
            f"{stops} stops: {long * 1e3:.0f} ms, {long / ours:.1f} times that of 20; closed form {closed * 1e3:.0f} ms"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
