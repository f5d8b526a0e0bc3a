"""Name the faults of a drive, keep the estimate right, and leave faultless drives in peace: how often that works.

    python benchmarks/faults.py --quick

A Khepera-like robot, 20 stops, 0.2 px, slip 0.3 mm/sqrt(m). Faults: one leg on which a wheel spins for 3 cm; the robot
lifted and put down elsewhere; 2 % of the corners displaced by 3 to 30 px; the box pushed by 5 mm half way. Each run
draws everything anew, the leg too.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from math import radians

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.likelihood import Estimate
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.calib.uncertainty.cramer_rao import Truth, errors
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array
from boxcal.target.box import make_target

STOPS = 20
SIGMA_PX = 0.2
SLIP = 0.0003
STEP = radians(0.1302)
Fault = Callable[[Drive, np.random.Generator], tuple[Correspondences, str]]


def clean_drive(rng: np.random.Generator) -> Drive:
    options = DriveOptions(stops=STOPS, slip=SLIP, encoder_step=STEP, steps_per_sample=4)
    return simulate_drive(khepera(), make_target(), options, rng)


def seen(drive: Drive, rng: np.random.Generator) -> Correspondences:
    return exact_correspondences(khepera(), make_target(), drive, SIGMA_PX, rng)


def no_fault(drive: Drive, rng: np.random.Generator) -> tuple[Correspondences, str]:
    return seen(drive, rng), ""


def spin(drive: Drive, rng: np.random.Generator) -> tuple[Correspondences, str]:
    """One wheel turns by 3 cm without moving the robot, somewhere on a leg."""
    data = seen(drive, rng)
    leg = int(rng.integers(STOPS - 1))
    first, last = data.stops[leg].last_sample + 1, data.stops[leg + 1].first_sample - 1
    at = int(rng.integers(first, last))
    right = bool(rng.integers(2))
    angle = 0.03 / (khepera().rR if right else khepera().rL)
    extra = np.where(np.arange(len(data.wheels)) >= at, round(angle / STEP) * STEP, 0.0)
    wheels = WheelSamples(
        t_ns=data.wheels.t_ns,
        phi_R=data.wheels.phi_R + extra * right,
        phi_L=data.wheels.phi_L + extra * (not right),
    )
    stops = tuple(
        replace(s, phi_R=float(wheels.phi_R[s.first_sample]), phi_L=float(wheels.phi_L[s.first_sample]))
        for s in data.stops
    )
    return replace(data, wheels=wheels, stops=stops), f"leg {leg}"


def lifted(drive: Drive, rng: np.random.Generator) -> tuple[Correspondences, str]:
    """From some stop on the robot stands elsewhere: carried by 10 to 20 cm and turned by 20 to 60 deg meanwhile.

    Stops after it see the box from where they would stand anyway; it is the wheels that did not turn on that leg.
    """
    data = seen(drive, rng)
    leg = int(rng.integers(STOPS - 1))
    a, b = data.stops[leg], data.stops[leg + 1]
    lost = slice(a.last_sample + 1, b.first_sample)
    count = lost.stop - lost.start
    from_, to = lost.start + count // 3, lost.start + 2 * count // 3
    phi = []
    for angle in (data.wheels.phi_R, data.wheels.phi_L):
        held = angle.copy()
        held[to:] -= held[to] - held[from_]
        held[from_:to] = held[from_]
        phi.append(held)
    wheels = WheelSamples(t_ns=data.wheels.t_ns, phi_R=phi[0], phi_L=phi[1])
    stops = tuple(
        replace(s, phi_R=float(wheels.phi_R[s.first_sample]), phi_L=float(wheels.phi_L[s.first_sample]))
        for s in data.stops
    )
    return replace(data, wheels=wheels, stops=stops), f"leg {leg}"


def wrong_corners(drive: Drive, rng: np.random.Generator) -> tuple[Correspondences, str]:
    """2 % of the corners lie 3 to 30 px off."""
    data = seen(drive, rng)
    stops: list[StopObservation] = []
    for s in data.stops:
        uv = s.uv_px.copy()
        wrong = rng.random(len(uv)) < 0.02
        angle, size = rng.uniform(0, 2 * np.pi, len(uv)), rng.uniform(3, 30, len(uv))
        uv += wrong[:, None] * size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        stops.append(replace(s, uv_px=uv))
    moved = [
        f"{j}:{k}"
        for j, (s, t) in enumerate(zip(data.stops, stops, strict=True))
        for k in s.landmark_ids[np.any(s.uv_px != t.uv_px, axis=1)]
    ]
    return replace(data, stops=tuple(stops)), " ".join(moved)


def pushed_box(drive: Drive, rng: np.random.Generator) -> tuple[Correspondences, str]:
    """From the middle of the drive on the box stands 5 mm further, turned by up to 0.5 deg."""
    half = STOPS // 2
    angle = rng.uniform(0, 2 * np.pi)
    T_old_new = planar(0.005 * np.cos(angle), 0.005 * np.sin(angle), rng.uniform(-1, 1) * radians(0.5))
    T_box_cam: Array = drive.T_box_cam.copy()
    T_box_cam[half:] = inverse(T_old_new) @ T_box_cam[half:]
    return seen(replace(drive, T_box_cam=T_box_cam), rng), f"leg {half - 1}"


FAULTS: dict[str, Fault] = {
    "wheel spins 3 cm": spin,
    "robot lifted": lifted,
    "2 % wrong corners": wrong_corners,
    "box pushed 5 mm": pushed_box,
}


def truth_of(drive: Drive) -> Truth:
    return Truth.of(khepera(), drive.stop_poses, slip=SLIP, encoder_step=STEP)


def named(found: Estimate, fault: str) -> tuple[bool, int]:
    """Return whether what was done was named, and how many other things were."""
    legs = {f"leg {leg.leg}" for leg in found.flagged_legs}
    corners = {f"{c.stop}:{c.landmark_id}" for c in found.flagged_corners}
    if fault.startswith("leg"):
        return fault in legs, len(legs - {fault}) + len(corners)
    wrong = set(fault.split())
    return len(wrong & corners) >= 0.99 * len(wrong), len(corners - wrong) + len(legs)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--runs", type=int, default=40, help="runs of each fault (40)")
    parser.add_argument("--clean", type=int, default=200, help="faultless runs (200)")
    parser.add_argument("--quick", action="store_true", help="5 runs of each fault, 20 faultless ones")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    runs, clean = (5, 20) if arguments.quick else (arguments.runs, arguments.clean)
    print("named: runs in which the fault was named; others: runs that named something else too;")
    print("worst: largest error of any of the 14 parameters over its sigma (rms over the runs in brackets)")
    for k, (name, fault) in enumerate(FAULTS.items()):
        hits, others, worst, failed = 0, 0, [], 0
        for run in range(runs):
            rng = np.random.default_rng([arguments.seed, k, run])
            drive = clean_drive(rng)
            data, what = fault(drive, rng)
            try:
                found = estimate([data])
            except CalibError as error:
                print(f"  run {run}: {error}")
                failed += 1
                continue
            hit, other = named(found, what)
            hits, others = hits + hit, others + (other > 0)
            worst.append(errors(found, truth_of(drive)) / np.sqrt(np.diag(found.cov)))
        z = np.abs(np.array(worst))
        print(
            f"{name:20} {runs} runs, {failed} failed: named {hits}, others {others}, worst {z.max():.2f} "
            f"({np.sqrt(np.mean(z**2)):.2f}), runs beyond 3 sigma {int(np.sum(np.any(z > 3, axis=1)))}",
            flush=True,
        )
    legs, corners, scores = 0, 0, list[np.ndarray]()
    for run in range(clean):
        rng = np.random.default_rng([arguments.seed, 99, run])
        drive = clean_drive(rng)
        found = estimate([seen(drive, rng)])
        legs, corners = legs + bool(found.flagged_legs), corners + bool(found.flagged_corners)
        scores.append(errors(found, truth_of(drive)) / np.sqrt(np.diag(found.cov)))
    beyond = int(np.sum(np.any(np.abs(scores) > 3, axis=1)))
    print(
        f"{'no fault':20} {clean} runs: a leg named in {legs}, a corner in {corners} (1 % stated for each), "
        f"runs beyond 3 sigma {beyond} (3.7 % expected of 14 independent parameters)"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
