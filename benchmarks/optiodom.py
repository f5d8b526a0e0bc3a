"""Real wheels: how well a calibration from other runs predicts where an unseen run ends.

    python benchmarks/optiodom.py --quick

Seven runs of a real differential-drive robot with encoders and motion capture (../shared/data/optiodom). A simulated
camera is carried along the captured path and looks every second (benchmarks/captured.py). Each run is left out in turn:
the others are solved together, the calibration and the left-out run's encoders predict where that run ends. The clocks
of encoders and capture agree to a few hundredths of a second only; the table has the runs as recorded, and with the
clocks fitted (an offset and a rate for each run). The robot is sampled as it moves, so legs are not tested for faults.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from blocks import fill, table
from captured import NOMINAL, T_CAPTURED_CAM, CapturedRun, carry_camera, load_run, with_clock

from boxcal.calib.geometry.so3_se3 import exp_so3, inverse, planar, rigid
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.likelihood.leg_model import LegModel, leg_model
from boxcal.calib.likelihood.wheel_path import WheelPath
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "../shared/data/optiodom"
_INSIDE_95 = 5.991
"""95 % quantile of chi-square with two degrees of freedom."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ending:
    """Where an unseen run was said to end, against where it ended.

    Attributes
    ----------
    run, length
        Its name; path length, m.
    nominal, calibrated : m
        Distance from the true end, predicted with nominal and with calibrated values.
    sigma : m
        Predicted standard deviation of the distance (root of the variances' sum): calibration and slip.
    by_calibration : m
        The part of it that is the calibration's.
    square
        Squared error over the predicted covariance; 2 on average where the prediction holds.
    """

    run: str
    length: float
    nominal: float
    calibrated: float
    sigma: float
    by_calibration: float
    square: float


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--quick", action="store_true", help="the first three runs, clocks fitted")
    parser.add_argument("--out", type=Path, help="folder of accuracy.md (docs; with --quick none)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    out = args.out or (None if args.quick else ROOT / "docs")
    files = sorted(DATA.glob("*/*_run-*.csv"))
    if not files:
        print("no ../shared/data/optiodom beside the project: nothing to predict")
        return 0
    recorded = [load_run(path) for path in files[: 3 if args.quick else None]]
    fitted = [with_clock(run) for run in recorded]
    for run in fitted:
        first, last = 1e3 * run.clock
        print(f"{run.name}: capture's clock off by {first:+.0f} ms at first, {last:+.0f} ms at last")
    cases = {"clocks fitted": fitted} if args.quick else {"as recorded": recorded, "clocks fitted": fitted}
    parts = [f"{name}:\n\n{_leave_one_out(runs, args.seed)}" for name, runs in cases.items()]
    text = "\n\n".join(parts)
    print(text)
    if out:
        fill(out / "accuracy.md", "optiodom", text)
    return 0


def _leave_one_out(runs: list[CapturedRun], seed: int) -> str:
    seen = [carry_camera(run, np.random.default_rng([seed, k])) for k, run in enumerate(runs)]
    endings, found = [], []
    for k, run in enumerate(runs):
        others: list[Correspondences] = [s for j, s in enumerate(seen) if j != k]
        found.append(estimate(others, None, EstimateOptions(find_faults=False)))
        endings.append(_ending(run, found[-1]))
    head = [
        "unseen run",
        "path (m)",
        "nominal (mm)",
        "calibrated (mm)",
        "sigma (mm)",
        "of it calibration",
        "error/sigma",
    ]
    rows = [
        [e.run, f"{e.length:.1f}"]
        + [f"{1e3 * v:.1f}" for v in (e.nominal, e.calibrated, e.sigma, e.by_calibration)]
        + [f"{np.sqrt(e.square / 2):.2f}"]
        for e in endings
    ]
    nominal, ours = (float(np.mean([getattr(e, n) for e in endings])) for n in ("nominal", "calibrated"))
    inside = sum(e.square <= _INSIDE_95 for e in endings)
    whole = np.sqrt(np.mean([e.square for e in endings]) / 2)
    last = found[-1]
    return (
        f"{table(head, rows)}\n\nmean {1e3 * nominal:.1f} mm with nominal figures, {1e3 * ours:.1f} mm calibrated: "
        f"**{nominal / ours:.1f} times better**. {inside} of {len(endings)} ends lie inside their 95 % ellipse; error "
        f"over sigma {whole:.2f} (rms). Calibration without {endings[-1].run}: rR {1e3 * last.rR:.3f} ± "
        f"{1e3 * last.sigma['rR']:.3f}, rL {1e3 * last.rL:.3f} ± {1e3 * last.sigma['rL']:.3f}, b {1e3 * last.b:.2f} ± "
        f"{1e3 * last.sigma['b']:.2f} mm, slip {1e3 * last.noise.slip:.1f} mm/sqrt(m). "
        f"{_turn_errors(runs, last)}"
    )


def _turn_errors(runs: list[CapturedRun], found: Estimate) -> str:
    """Return in words how the errors of single seconds' turns add up over a run."""
    square, whole = 0.0, []
    for run in runs:
        turn = run.pose[:, 2] - run.phi @ np.array([found.rR, -found.rL]) / found.b
        each = np.diff(turn[::20])
        square += float(each @ each)
        whole.append(float(each.sum()))
    seconds = sum(len(run.t) // 20 for run in runs)
    single, total, independent = np.degrees(
        [np.sqrt(square / seconds), np.sqrt(np.mean(np.square(whole))), np.sqrt(square / len(runs))]
    )
    return (
        f"Turns of single seconds differ by {single:.2f} deg (rms) between wheels and capture; over a run that adds up "
        f"to {total:.1f} deg, where independent errors would to {independent:.1f} deg."
    )


def _ending(run: CapturedRun, found: Estimate) -> Ending:
    start, end = planar(*run.pose[0]), run.pose[-1, :2]
    values = np.array([found.rR, found.rL, found.b])
    T_body_cam = found.T_body_cam
    model = _whole_run(run, values)
    error = _end(start, model.displacement[0], T_body_cam) - end

    def moved(k: int, step: float) -> Array:
        change = np.zeros(9)
        change[k] = step
        T = T_body_cam @ rigid(exp_so3(change[3:6]), np.zeros(3))
        T[:3, 3] += change[6:]
        leg = _whole_run(run, values + change[:3])
        return _end(start, leg.displacement[0], T)

    step = 1e-6
    J = np.stack([(moved(k, step) - moved(k, -step)) / (2 * step) for k in range(9)], axis=1)
    by_leg = np.stack(
        [
            (_end(start, model.displacement[0] + d, T_body_cam) - _end(start, model.displacement[0] - d, T_body_cam))
            / (2 * step)
            for d in step * np.eye(3)
        ],
        axis=1,
    )
    systematic = J @ found.cov[5:, 5:] @ J.T
    cov = systematic + found.noise.slip**2 * by_leg @ model.slip[0] @ by_leg.T
    nominal = _end(start, _whole_run(run, np.array(NOMINAL)).displacement[0], T_CAPTURED_CAM) - end
    return Ending(
        run=run.name,
        length=float(np.sum(np.hypot(*np.diff(run.pose[:, :2], axis=0).T))),
        nominal=float(np.linalg.norm(nominal)),
        calibrated=float(np.linalg.norm(error)),
        sigma=float(np.sqrt(np.trace(cov))),
        by_calibration=float(np.sqrt(np.trace(systematic))),
        square=float(error @ np.linalg.solve(cov, error)),
    )


def _whole_run(run: CapturedRun, wheels: Array) -> LegModel:
    """Return what the wheels say about the run as one leg."""
    dphi = np.diff(run.phi, axis=0)
    path = WheelPath(
        dphi=dphi,
        starts=np.zeros(1, dtype=np.int64),
        leg=np.zeros(len(dphi), dtype=np.int64),
        moving=(np.flatnonzero(dphi[:, 0]), np.flatnonzero(dphi[:, 1])),
        phi_start=run.phi[:-1],
        t_start_ns=np.zeros(len(dphi), dtype=np.int64),
    )
    none = np.zeros((1, 2))
    return leg_model(path, wheels, none, none)


def _end(start: Array, displacement: Array, T_body_cam: Array) -> Array:
    """Return where the captured frame ends, (2,) m: it sits on the body as the calibrated camera says."""
    T_captured_body = T_CAPTURED_CAM @ inverse(T_body_cam)
    return np.asarray((start @ T_captured_body @ planar(*displacement) @ inverse(T_captured_body))[:2, 3])


if __name__ == "__main__":
    raise SystemExit(main())
