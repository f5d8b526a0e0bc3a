"""What robots that need none of it pay for a model of lean, of the target as built and of the camera.

    python benchmarks/clean_before.py

Errors and sigmas of the default likelihood on clean drives (a perfect box, a flat floor, the paper's camera), against
those of an older commit on the same drives, by its own code. The default is the last commit before all that was part of
the likelihood. Beside it today's with exact landmarks and the paper's camera model, and the default with the
information that corners' noise is white, as it is here.
"""

import argparse
from pathlib import Path

import numpy as np
from older_tree import BEFORE, ROOT, older_tree, printed

from boxcal.calib.geometry.parameters import ORDER
from boxcal.target.arrays import Array

DRIVES = """
import json, sys
sys.path.insert(0, "benchmarks")
import numpy as np
import estimator
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.target.box import make_target
estimator.SIGMA_PX = 0.05
robot, target = estimator.paper(), make_target()
plan = estimator.route(robot, target, 14)
def drives():
    for run in range({runs}):
        yield estimator.drive(robot, target, plan, 5e-4, np.random.default_rng([11, run]))
def figures(found, truth):
    return [estimator.errors(found, truth).tolist(), np.sqrt(np.diag(found.cov)[:14]).tolist()]
"""
OLD = """
print(json.dumps({"before": [figures(estimate([seen], None), truth) for seen, truth in drives()]}))
"""
NEW = """
from boxcal.calib.diagnosis.explained_estimate import estimate_explained
kinds = {
    "exact landmarks, one camera model": EstimateOptions(systematic_share=0.0),
    "default, white noise": EstimateOptions(lens=None, target=target, systematic_share=0.0),
    "default": EstimateOptions(lens=None, target=target),
}
print(json.dumps({
    kind: [figures(estimate_explained([seen], None, options)[0], truth) for seen, truth in drives()]
    for kind, options in kinds.items()
}))
"""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--before", default=BEFORE, metavar="COMMIT", help=f"commit to compare with ({BEFORE})")
    parser.add_argument("--runs", type=int, default=30, help="drives (30)")
    arguments = parser.parse_args()
    drives = DRIVES.replace("{runs}", str(arguments.runs))
    with older_tree(arguments.before) as tree:
        before = of(printed(drives + OLD, tree)["before"])
    print(f"{arguments.runs} drives; rms error / that of {arguments.before}, and median sigma / that")
    today = {kind: of(figures) for kind, figures in printed(drives + NEW, Path(ROOT)).items()}
    print(" " * 6 + "".join(f"{kind:>36}" for kind in today))
    for k, name in enumerate(ORDER):
        text = ""
        for error, sigma in today.values():
            ratio = np.sqrt(np.mean(error[:, k] ** 2) / np.mean(before[0][:, k] ** 2))
            text += f"{ratio:30.2f}{np.median(sigma[:, k] / before[1][:, k]):6.2f}"
        print(f"{name:6}{text}")
    return 0


def of(figures: list[list[list[float]]]) -> tuple[Array, Array]:
    """Return errors and sigmas, (n, 14) each."""
    both = np.array(figures)
    return both[:, 0], both[:, 1]


if __name__ == "__main__":
    raise SystemExit(main())
