"""How often can a cause of some size be found at all? What score tests expect of it, on drives without it.

The information I that a drive has on a cause's unknowns, all others eliminated, says how a cause of size x would look:
its score is normal about ``I x`` with covariance I. So its Bayes factor (with the prior of the catalogue) is known
beforehand; over ``exp(5)`` the cause is named. Printed for drives and sizes as ``benchmarks/explanations.py`` draws
them: ``x I x`` (how far the cause lies from none, squared, in its own sigmas), the mean logarithm of its Bayes factor
over all that its family tries, and the chance that it is named; then for the recorded log with eccentric wheels.

    python benchmarks/power.py
"""

import argparse
from collections.abc import Callable, Sequence
from math import pi, radians
from pathlib import Path

import numpy as np

from boxcal.calib.diagnosis.camera_knocked import CameraKnocked
from boxcal.calib.diagnosis.catalogue import candidates
from boxcal.calib.diagnosis.cause import Cause
from boxcal.calib.diagnosis.choose import NEEDED
from boxcal.calib.diagnosis.eccentric import Eccentric
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import fit
from boxcal.calib.likelihood.fit import Fit
from boxcal.calib.likelihood.score_test import score_tests
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfect_drive import hand_made, imperfect_drive
from boxcal.calib.simulate.robot import khepera, turtlebot
from boxcal.detect.extract import extract
from boxcal.target.arrays import Array
from boxcal.target.box import make_target

TARGET = make_target()
OPTIONS = EstimateOptions(target=TARGET, lens=None)
STOPS = 14
LOG = Path(__file__).resolve().parents[1] / "../shared/data/rooms/eccentric.mcap"
_DRAWS = 1000

Draw = Callable[[np.random.Generator, float], Array]


def eccentric(rng: np.random.Generator, percent: float) -> Array:
    a, b = rng.uniform(0, 2 * pi, 2)
    return percent / 100 * np.array([np.cos(a), np.sin(a), np.cos(b), np.sin(b)])


def backlash(_: np.random.Generator, degrees: float) -> Array:
    return np.full(2, radians(degrees))


def knock(rng: np.random.Generator, degrees: float) -> Array:
    axis = rng.standard_normal(3)
    return radians(degrees) * axis / np.linalg.norm(axis)


def is_both(cause: Cause) -> bool:
    return isinstance(cause, Eccentric) and len(cause.wheels) == 2


def is_backlash(cause: Cause) -> bool:
    return cause.family == "backlash"


def is_turn(cause: Cause) -> bool:
    """Return whether a cause is a camera that was turned slightly in the middle of the drive."""
    return isinstance(cause, CameraKnocked) and cause.small and cause.stop == STOPS // 2


CAUSES: dict[str, tuple[Callable[[Cause], bool], Draw, tuple[float, ...], str]] = {
    "wheels out of round": (is_both, eccentric, (0.3, 1.0), "%"),
    "backlash": (is_backlash, backlash, (0.5, 1.0), "deg"),
    "camera knocked": (is_turn, knock, (0.1, 0.2), "deg"),
}


def expected(found: Fit, which: Callable[[Cause], bool], draw: Draw, size: float) -> tuple[float, float, float]:
    """Return mean ``x I x``, mean logarithm of the Bayes factor, and the chance that it is enough."""
    rng = np.random.default_rng(0)
    causes = candidates(found)
    (cause,) = (c for c in causes if which(c))
    (test,) = score_tests(found, [cause])
    prior = np.array(cause.prior)
    information = np.linalg.inv(test.cov) - np.diag(prior**-2)
    width = np.linalg.slogdet(np.eye(len(prior)) + information * np.outer(prior, prior))[1]
    tried = sum(c.family == cause.family for c in causes)
    x = np.array([draw(rng, size) for _ in range(_DRAWS)])
    score = x @ information + rng.standard_normal(x.shape) @ np.linalg.cholesky(information).T
    log_bayes = 0.5 * (np.einsum("ni,ij,nj->n", score, test.cov, score) - width) - np.log(tried)
    far = np.einsum("ni,ij,nj->n", x, information, x)
    return float(far.mean()), float(log_bayes.mean()), float(np.mean(log_bayes > NEEDED))


def usual(run: int) -> Fit:
    """Return the solution of a drive without any of these causes."""
    rng, robot = np.random.default_rng([5, run]), (turtlebot, khepera)[run % 2]()
    options = DriveOptions(stops=STOPS, steps_per_sample=4)
    return fit([imperfect_drive(robot, TARGET, options, hand_made(rng), rng).seen], None, OPTIONS)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=10, help="drives (10)")
    arguments = parser.parse_args(argv)
    fits = [usual(run) for run in range(arguments.runs)]
    print(f"{'cause':24}{'size':>10}{'x I x':>8}{'log Bayes factor':>18}{'named':>8}")
    for name, (which, draw, sizes, unit) in CAUSES.items():
        for size in sizes:
            far, gain, chance = np.mean([expected(found, which, draw, size) for found in fits], axis=0)
            print(f"{name:24}{f'{size:g} {unit}':>10}{far:8.1f}{gain:18.1f}{100 * chance:6.0f} %")
    if LOG.exists():
        found = fit([extract(LOG, TARGET)], None, OPTIONS)
        far, gain, chance = expected(found, is_both, eccentric, 1.0)
        print(f"{'rooms/eccentric.mcap':24}{'1 %':>10}{far:8.1f}{gain:18.1f}{100 * chance:6.0f} %")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
