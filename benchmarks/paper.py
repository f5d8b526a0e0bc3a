"""The figures and claims of Antonelli et al. 2010 (DOI 10.1007/s11370-010-0067-2), from simulated and recorded drives.

    python benchmarks/paper.py --quick

Section 4: wheels, extrinsics, image size, encoder step (0.1302 deg) and T = 0.02 s are the paper's; what it leaves open
is chosen as docs/paper.md lists. Section 5: a simulated Khepera III with the paper's results as its truth, and the log
../shared/data/fleet/khepera.mcap where it is present. A whole run writes tables and figures to docs/; --quick (few
runs, half the figures' stops) writes only where --out says.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from blocks import fill, table
from growth import Growth, grow
from pictures import growths, histograms
from plans import best_plan
from runs import ANGLES, MOTION, PARAMETERS, TRANSLATION, Runs, Setting, drive, rms, simulate_runs, true_values

from boxcal.calib.compare.ground_truth import load_truth, truth_path
from boxcal.calib.geometry.so3_se3 import rot_y, rot_z
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.simulate.robot import khepera, paper
from boxcal.detect.extract import extract
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel

ROOT = Path(__file__).resolve().parents[1]
LOG = ROOT / "../shared/data/fleet/khepera.mcap"
SLIP = 1e-3
EXPERIMENT = Setting(stops=20, sigma_px=0.4, slip=0.3e-3)
"""0.4 px on each axis is the paper's mean error of 0.5 px; slip as in the recorded log."""
_PLANS = 60
_LENGTHS = {"fu": (600.0, "%"), "fv": (600.0, "%"), "rR": (0.03, "%"), "rL": (0.03, "%"), "b": (0.08, "%")}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=200, help="runs of each setting (200)")
    parser.add_argument(
        "--quick", action="store_true", help="4 runs of each setting, figures 8 and 9 from 5 values of P"
    )
    parser.add_argument("--out", type=Path, help="folder of paper.md and pictures/ (docs; with --quick none)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    out = args.out or (None if args.quick else ROOT / "docs")
    runs = 4 if args.quick else args.runs
    five = Setting(stops=5, plan=best_plan(paper(), make_target(), Setting(stops=5), 8 if args.quick else _PLANS))
    cases = {
        "P = 5": five,
        "P = 5, random routes": Setting(stops=5),
        "P = 15": Setting(stops=15),
        "P = 5, slip": replace(five, slip=SLIP),
        "P = 15, slip": Setting(stops=15, slip=SLIP),
        "P = 20, slip": Setting(stops=20, slip=SLIP),
    }
    found = {name: simulate_runs(paper(), setting, runs, args.seed) for name, setting in cases.items()}
    drives = section_5([3, 4, 8, 14, 20] if args.quick else list(range(3, 21)), args.seed)
    tables = {
        "claims": claims(found, drives),
        "errors": errors({name: found[name] for name in ("P = 5", "P = 5, random routes", "P = 15")}),
        "slip": errors({name: found[name] for name in cases if name.endswith("slip")}) + least_ratios(found),
        "experiment": experiment(drives),
    }
    print(f"{runs} runs of each setting; runs without a result (paper's procedure, likelihood): ", end="")
    print("; ".join(f"{name} {r.failed[0]}, {r.failed[1]}" for name, r in found.items()))
    for name, text in tables.items():
        print(f"\n{name}\n{text}")
    if out:
        for name, text in tables.items():
            fill(out / "paper.md", name, text)
        draw(out / "pictures", found["P = 15"], drives, runs)
    return 0


def section_5(stops: list[int], seed: int) -> list[Growth]:
    """Return the estimates over the number of stops, simulated and from the log."""
    robot, target = khepera(), make_target()
    _, seen = drive(robot, target, EXPERIMENT, np.random.default_rng([seed, 8]))
    found = [grow("simulated Khepera III", seen, true_values(robot), EstimateOptions(), stops)]
    if not LOG.exists():
        print("no ../shared/data/fleet/khepera.mcap beside the project: figures 8 and 9 are of the simulation alone")
        return found
    log = extract(LOG, target)
    truth = load_truth(truth_path(LOG))
    true = true_values(
        replace(
            robot,
            camera=CameraModel(**{n: getattr(truth.camera, n) for n in ("fu", "fv", "cu", "cv", "kr")}),
            rR=truth.wheels.rR,
            rL=truth.wheels.rL,
            b=truth.wheels.b,
            T_body_cam=truth.T_body_cam,
        )
    )
    options = EstimateOptions(target=target, ink_sigma=1e-4)
    stops = [P for P in stops if len(log.stops) >= P]
    return [*found, grow("log khepera.mcap (rendered frames)", log, true, options, stops)]


def least_ratios(found: dict[str, Runs]) -> str:
    """Return the least gain over the parameters that slip spoils, in words."""
    least = {name: float(ratio(found[name])[list(MOTION)].min()) for name in found if name.endswith("slip")}
    text = ", ".join(f"{value:.1f} at {name.removesuffix(', slip')}" for name, value in least.items())
    return f"\n\nLeast ratio over rR, rL, b, a1, tx and ty, which slip spoils: {text}."


def ratio(runs: Runs) -> Array:
    """Return the paper's procedure's rms error over ours, (14,)."""
    both = np.isfinite(runs.closed[:, :1]) & np.isfinite(runs.likelihood[:, :1])
    return np.asarray(rms(np.where(both, runs.closed, np.nan)) / rms(np.where(both, runs.likelihood, np.nan)))


def mounting_percent(errors: Array) -> tuple[float, float]:
    """Return the rms relative error of the extrinsics' R and t, percent, as Frobenius norms over the truth's."""
    true = true_values(paper())
    good = errors[np.isfinite(errors[:, 0])]
    R = _rotation(true[ANGLES])
    off = [np.linalg.norm(_rotation(a) - R) / np.linalg.norm(R) for a in true[ANGLES] + good[:, ANGLES]]
    shift = np.linalg.norm(good[:, TRANSLATION], axis=1) / np.linalg.norm(true[TRANSLATION])
    return 100 * float(np.sqrt(np.mean(np.square(off)))), 100 * float(np.sqrt(np.mean(shift**2)))


def _rotation(a: Array) -> Array:
    return np.asarray(rot_z(float(a[0])) @ rot_y(float(a[1])) @ rot_z(float(a[2])))


def claims(found: dict[str, Runs], drives: list[Growth]) -> str:
    """Return the paper's claims beside ours."""
    five, any_five, fifteen, slip = (
        found[name] for name in ("P = 5", "P = 5, random routes", "P = 15", "P = 20, slip")
    )
    true, wheels = true_values(paper()), [5, 6, 7]

    def odometry(errors: Array) -> str:
        return ", ".join(f"{v:.3f}" for v in 100 * rms(errors)[wheels] / true[wheels]) + " %"

    def median(errors: Array) -> str:
        return ", ".join(f"{v:.3f}" for v in 100 * np.nanmedian(np.abs(errors), axis=0)[wheels] / true[wheels]) + " %"

    def mounting(errors: Array) -> str:
        return "R {:.2f} %, t {:.2f} %".format(*mounting_percent(errors))

    def singular(values: Array) -> str:
        return "{:.1e}, {:.2f}".format(*np.nanmedian(values, axis=0))

    simulated = drives[0]
    m = 1e3 * (simulated.truth[wheels])

    def last(errors: Array) -> str:
        return ", ".join(f"{v:.3f}" for v in m + 1e3 * errors[-1][wheels])

    rows = [
        ["P = 5: rR, rL, b (rms)", "0.1 %", odometry(five.closed), odometry(five.likelihood)],
        ["P = 5: mounting (rms)", "1 %", mounting(five.closed), mounting(five.likelihood)],
        ["P = 5, random routes: rR, rL, b (median)", "", median(any_five.closed), median(any_five.likelihood)],
        ["P = 15: rR, rL, b (rms)", "fig. 5", odometry(fifteen.closed), odometry(fifteen.likelihood)],
        ["P = 15: mounting (rms)", "fig. 6", mounting(fifteen.closed), mounting(fifteen.likelihood)],
        ["P = 5: sigma5/sigma4, sigma4/sigma3", "1e-3, 0.8", singular(five.singular), ""],
        ["P = 15: sigma5/sigma4, sigma4/sigma3", "1e-3, 0.8", singular(fifteen.singular), ""],
        ["P = 20, slip 1 mm/sqrt(m): the same", "", singular(slip.singular), ""],
        ["Khepera III, P = 20: the same", "5e-2, 0.7", singular(simulated.singular[-1:]), ""],
        ["Khepera III: rR, rL, b (mm)", "20.9, 20.8, 89.1", last(simulated.closed), last(simulated.likelihood)],
        ["Khepera III: pixel error (px)", "0.5 mean", f"{simulated.rms_px:.2f} rms", ""],
    ]
    return table(["claim", "paper", "its procedure here", "likelihood"], rows)


def errors(found: dict[str, Runs]) -> str:
    """Return the rms error of every parameter for both procedures, and the ratio."""
    head, rows = ["parameter"], [[f"{name} ({_unit(name)[1]})" if _unit(name)[1] else name] for name in PARAMETERS]
    for name, runs in found.items():
        head += [f"{name}: paper's", "ours", "ratio"]
        closed, ours, gain = rms(runs.closed), rms(runs.likelihood), ratio(runs)
        for k, row in enumerate(rows):
            factor = _unit(PARAMETERS[k])[0]
            row += [f"{closed[k] * factor:.3g}", f"{ours[k] * factor:.3g}", f"{gain[k]:.1f}"]
    return table(head, rows)


def _unit(name: str) -> tuple[float, str]:
    """Return what turns an error of a parameter into the table's unit, and that unit."""
    if name in _LENGTHS:
        return 100 / _LENGTHS[name][0], "%"
    if name.startswith("a"):
        return float(np.degrees(1)), "deg"
    return (1e3, "mm") if name.startswith("t") else (1.0, "px" if name != "kr" else "")


def experiment(drives: list[Growth]) -> str:
    """Return wheels and extrinsics over the number of stops, with sigmas."""
    names = ("rR", "rL", "b", "a1", "tx", "ty")
    head = ["drive, P", *(f"{n} ({'deg' if n == 'a1' else 'mm'})" for n in names)]
    rows = []
    ks = [PARAMETERS.index(n) for n in names]
    scale = np.array([np.degrees(1) if n == "a1" else 1e3 for n in names])
    for drive_ in drives:
        truth = drive_.truth[ks] * scale
        rows.append([f"{drive_.title}: truth", *(f"{v:.3f}" for v in truth)])
        for P in (5, 8, 14, 20):
            if P not in drive_.stops:
                continue
            at = int(np.flatnonzero(drive_.stops == P)[0])
            closed, ours, sigma = (a[at][ks] * scale for a in (drive_.closed, drive_.likelihood, drive_.sigma))
            rows.append([f"P = {P}, paper's procedure", *(f"{v:.3f}" for v in truth + closed)])
            pairs = zip(truth + ours, sigma, strict=True)
            rows.append([f"P = {P}, likelihood", *(f"{v:.3f} ± {s:.3f}" for v, s in pairs)])
    return table(head, rows)


def draw(folder: Path, runs: Runs, drives: list[Growth], count: int) -> None:
    """Write the four figures."""
    title = f"P = 15, {count} runs on random routes"
    truth = true_values(paper())
    histograms(folder / "paper-fig5-radii.png", ("rL", "rR"), truth, runs, title)
    histograms(folder / "paper-fig6-translation.png", ("tx", "ty"), truth, runs, title)
    growths(folder / "paper-fig8-odometry.png", drives, (("b",), ("rL", "rR")), errors=False)
    growths(folder / "paper-fig9-mounting.png", drives, (("tx", "ty"), ("a1", "a2", "a3")), errors=True)
    for name in sorted(folder.glob("paper-fig*.png")):
        print(f"wrote {name.name}")


if __name__ == "__main__":
    raise SystemExit(main())
