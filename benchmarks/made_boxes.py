"""Are the sigmas right around boxes as people make them? Robots around boxes drawn from the estimator's own priors.

A drive with a perfect box cannot show how high its sheets are glued, so tz is as certain as hand-made boxes are alike,
and errors of robots around a perfect box lie far inside the sigmas. Here prints, sheets, faces and bows are drawn from
the priors (:data:`boxcal.calib.likelihood.target_deformation.HAND_MADE`), as are the tilt of the floor and the size of
the box as a whole, which no image shows; corners err by white noise; what else is not exact stands in
:mod:`boxcal.calib.simulate.imperfections`. Printed: root mean square of errors over sigmas (1 in the ideal), and how
often a 95 % interval holds the truth; beside it the same around perfect boxes.

    python benchmarks/made_boxes.py --quick
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
from kept_runs import KeptRuns

from boxcal.calib.diagnosis.explained_estimate import estimate_explained
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.target_deformation import HAND_MADE
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfect_drive import imperfect_drive
from boxcal.calib.simulate.imperfections import BoxFaults, CameraFaults, Imperfections, WheelFaults
from boxcal.calib.simulate.robot import Robot, khepera, turtlebot
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, make_target

TARGET = make_target()
STOPS = 14
GROUPS = {"camera": ORDER[:4], "wheels": ORDER[5:8], "extrinsics": ORDER[8:], "of it tz": ("tz",)}
"""Without kr: the camera model is chosen, and another model's first coefficient is another quantity."""
INSIDE = 1.959964
"""Standard deviations within which 95 % of a normal variable lie."""


def made(rng: np.random.Generator) -> BoxFaults:
    """Return a box drawn from the priors: prints and seat, places, turns and bows of the sheets on their faces."""
    scale = 1 + HAND_MADE["print"] * rng.standard_normal(2)
    seat = HAND_MADE["print"] * TARGET.box.height / 2 * rng.standard_normal()
    xyz = HAND_MADE["place"] * rng.standard_normal((FACES, 3))
    turns = HAND_MADE["turn"] * rng.standard_normal((FACES, 3))
    pose = np.column_stack([turns[:, :2], np.zeros((FACES, 3)), xyz[:, 2]])
    return BoxFaults(
        scale=(float(scale[0]), float(scale[1])),
        place=np.column_stack([xyz[:, 0], xyz[:, 1] + seat, turns[:, 2]]),
        pose=pose,
        bow=tuple((HAND_MADE["bow"] * rng.standard_normal(FACES)).tolist()),
    )


def one(kind: str, seed: int, run: int) -> dict[str, object]:
    """Return errors over sigmas by parameter of one robot, around a box of a kind: ``made`` or ``perfect``."""
    rng = np.random.default_rng([seed, run])
    robot = (turtlebot, khepera)[run % 2]()
    tilt = radians(1) * rng.standard_normal(2)
    faults = Imperfections(
        wheels=WheelFaults(slip=float(rng.uniform(2e-4, 8e-4))),
        camera=CameraFaults(lens=(rng.normal(0, 0.05), *rng.normal(0, 5e-4, 2), 0.0)),
        box=made(rng),
        lean=radians(0.05),
        tilt=(float(tilt[0]), float(tilt[1])),
    )
    if kind == "perfect":
        faults = replace(faults, box=BoxFaults())
    options = DriveOptions(stops=STOPS, steps_per_sample=4)
    seen = imperfect_drive(robot, TARGET, options, faults, np.random.default_rng([seed, run, 1])).seen
    found, _ = estimate_explained([seen], None, EstimateOptions(target=TARGET, lens=None, systematic_share=0.0))
    size = 1 + found.scale_sigma * rng.standard_normal() if kind == "made" else 1.0
    return {"z": errors_in_sigmas(found, robot, size).tolist(), "causes": [finding.cause for finding in found.findings]}


def errors_in_sigmas(found: Estimate, robot: Robot, size: float) -> Array:
    """Return errors over sigmas, (14,) in the reported order; lengths' with what the size of the box adds to them.

    A world larger by a factor gives the same images and wheel angles: ``size`` is that of box and robot together.
    """
    camera = [getattr(found.camera, n) - getattr(robot.camera, n) for n in ORDER[:5]]
    wheels = [getattr(found, n) - size * getattr(robot, n) for n in ORDER[5:8]]
    turned = log_so3(robot.T_body_cam[:3, :3].T @ found.T_body_cam[:3, :3])
    shifted = found.T_body_cam[:3, 3] - size * robot.T_body_cam[:3, 3]
    lengths = np.array([0.0] * 5 + [found.rR, found.rL, found.b] + [0.0] * 3 + found.T_body_cam[:3, 3].tolist())
    sigma = np.hypot([found.sigma[n] for n in ORDER], found.scale_sigma * lengths)
    return np.asarray(np.array([*camera, *wheels, *turned, *shifted]) / sigma)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=100, help="robots of each kind (100)")
    parser.add_argument("--quick", action="store_true", help="6 robots of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep every robot's outcome there, and go on with it")
    arguments = parser.parse_args(argv)
    runs, kept = 6 if arguments.quick else arguments.runs, KeptRuns(arguments.keep)
    print(f"{runs} robots, {STOPS} stops; rms of errors over sigmas, and share inside 95 % intervals")
    print(f"{'box':10}" + "".join(f"{name:>18}" for name in GROUPS))
    for kind in ("made", "perfect"):
        key = (kind, "sized", arguments.seed)
        found = [kept.outcome((*key, run), lambda r=run, k=kind: one(k, arguments.seed, r)) for run in range(runs)]
        z = np.array([outcome["z"] for outcome in found])
        text = ""
        for names in GROUPS.values():
            part = z[:, [ORDER.index(name) for name in names]]
            text += f"{np.sqrt(np.mean(part**2)):10.2f} {100 * np.mean(np.abs(part) < INSIDE):5.1f} %"
        print(f"{kind:10}{text}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
