"""Time the estimator: against the closed form, against general solvers, and over the number of stops.

    python benchmarks/estimator_speed.py

The general solvers are GTSAM (extra ``bench``) with our derivatives, and ``scipy.optimize.least_squares`` with numeric
ones, on the same residuals (corners, legs, priors), the same start, and noise levels that the estimator found: it is
timed with these given and nothing tested, too. Processor time, best of several runs, in one thread; what is compared
takes turns.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from math import radians

import numpy as np
from estimator_peers import Answer, through_gtsam, through_scipy

from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.four_steps.procedure import FourSteps, solve_four_steps
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import estimate, fit
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.correspondences import Correspondences
from boxcal.one_thread import one_thread
from boxcal.target.box import make_target


def drive(stops: int) -> tuple[Correspondences, FourSteps]:
    rng = np.random.default_rng(stops)
    options = DriveOptions(stops=stops, slip=0.0003, encoder_step=radians(0.1302), steps_per_sample=4)
    driven = simulate_drive(khepera(), make_target(), options, rng)
    data = exact_correspondences(khepera(), make_target(), driven, 0.2, rng)
    return data, solve_four_steps(data)


def anew(data: Correspondences) -> Correspondences:
    """Return the same drive as if it were another one: step 1 keeps the camera of the stops that it saw last."""
    return replace(data, stops=tuple(replace(stop) for stop in data.stops))


def best(work: Callable[[], object], times: int) -> float:
    """Return the least processor time of several runs, s: what other work on the machine hardly changes."""
    seconds = []
    for _ in range(times):
        begin = time.process_time()
        work()
        seconds.append(time.process_time() - begin)
    return min(seconds)


def compare(data: Correspondences, start: FourSteps, times: int) -> float:
    """Print the estimator's times beside those of general solvers, all taking turns; return the estimator's, s."""
    levels, found = fit([data], start).components, estimate([data], start)
    given = EstimateOptions(slip=levels.slip, noise_scale=levels.noise_scale, find_faults=False)
    ours = alone = np.inf
    answers: list[Answer] = []
    for _ in range(times):
        ours = min(ours, best(lambda: estimate([data], start), 1))
        alone = min(alone, best(lambda: estimate([data], start, given), 1))
        if find_spec("gtsam") is not None:
            answers.append(through_gtsam(data, start))
    print(f"  likelihood, levels, tests and covariance          {ours * 1e3:8.1f} ms")
    print(
        f"  ... levels given, no tests                        {alone * 1e3:8.1f} ms, {alone / ours:.2f} times as long"
    )
    if answers:
        against("GTSAM", min(answers, key=lambda answer: answer.seconds), found, ours)
    else:
        print("  GTSAM is not here: pip install '.[bench]'")
    against("scipy, numeric Jacobians", through_scipy(data, start), found, ours)
    return ours


def against(name: str, answer: Answer, found: Estimate, ours: float) -> None:
    """Print a general solver's time beside ours (s), and how far its answer is off."""
    off = np.abs(answer.wheels - (found.rR, found.rL, found.b)) / [found.sigma[k] for k in ("rR", "rL", "b")]
    print(
        f"  {f'{name} ({answer.evaluations} evaluations)':50}{answer.seconds * 1e3:8.1f} ms, "
        f"{answer.seconds / ours:.2f} times as long; rR, rL, b differ by {np.max(off):.3f} sigma at most"
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
    drives = [anew(data) for _ in range(times)]  # what a copy costs is not the steps'
    closed = best(lambda: solve_four_steps(drives.pop()), times)
    print(f"  the four closed-form steps                        {closed * 1e3:8.1f} ms")
    ours = compare(data, start, times)
    everything = EstimateOptions(lens=None, target=make_target())
    command = best(lambda: estimate_explained([data], start, everything), times)
    print(f"  the command's defaults: camera model, box and causes  {command * 1e3:8.1f} ms")
    for stops in (200, 500):
        data, start = drive(stops)
        drives = [anew(data)]
        closed = best(lambda drives=drives: solve_four_steps(drives.pop()), 1)
        long = best(lambda data=data, start=start: estimate([data], start), max(times // 2, 1))
        print(
            f"{stops} stops: {long * 1e3:.0f} ms, {long / ours:.1f} times that of 20; closed form {closed * 1e3:.0f} ms"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
