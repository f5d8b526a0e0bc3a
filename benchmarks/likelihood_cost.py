"""Cost of the default likelihood on a clean drive of 20 stops, against the likelihood of an older commit.

    python benchmarks/likelihood_cost.py

The older tree is taken out of the repository (``git archive``) and timed by its own code on the same drive, in turn
with today's. Processor time, best of several runs. The default is the last commit before lean, the target as built and
the choice of a camera model became part of the likelihood.
"""

import argparse

from older_tree import BEFORE, ROOT, older_tree, printed

GOAL = 1.5
OLD = """
import json, sys
sys.path.insert(0, "benchmarks")
from estimator_speed import best, drive
from boxcal.calib.likelihood import estimate
data, start = drive(20)
print(json.dumps({"likelihood": best(lambda: estimate([data], start), 7)}))
"""
NEW = """
import json, sys
sys.path.insert(0, "benchmarks")
from estimator_speed import best, drive
from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.target.box import make_target
data, start = drive(20)
paper, default = EstimateOptions(), EstimateOptions(lens=None, target=make_target())
timed = {
    "one camera model, exact landmarks": best(lambda: estimate([data], start, paper), 7),
    "default": best(lambda: estimate([data], start, default), 7),
    "default, with the search for causes": best(lambda: estimate_explained([data], start, default), 7),
}
print(json.dumps(timed))
"""


def main() -> int:
    """Print the times and their ratios."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--before", default=BEFORE, metavar="COMMIT", help=f"commit to compare with ({BEFORE})")
    parser.add_argument("--rounds", type=int, default=3, help="how often both are timed in turn (3)")
    args = parser.parse_args()
    with older_tree(args.before) as tree:
        rounds = [(printed(OLD, tree), printed(NEW, ROOT)) for _ in range(args.rounds)]
    before = min(old["likelihood"] for old, _ in rounds)
    print(f"likelihood of {args.before:38} {before * 1e3:7.1f} ms")
    for name in rounds[0][1]:
        seconds = min(new[name] for _, new in rounds)
        print(f"today's: {name:43} {seconds * 1e3:7.1f} ms, {seconds / before:.2f} times as long")
    print(f"goal of the default: {GOAL} times")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
