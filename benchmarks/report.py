"""What the reports cost: time and size a robot and of a fleet of 100, and how soon Chromium shows a page.

Example:
  python benchmarks/report.py
"""

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from boxcal.calib.assessment.verdict import judge
from boxcal.calib.diagnosis.first_look import first_look
from boxcal.calib.one_robot.solving import solve
from boxcal.calib.report.fleet import fleet_report
from boxcal.calib.report.robot import robot_report
from boxcal.calib.settings import Job, Settings
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.box import make_target

QUIET = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync")


def main() -> None:
    target, rng = make_target(), np.random.default_rng(1)
    robot = turtlebot("r01")
    drive = exact_correspondences(robot, target, simulate_drive(robot, target, DriveOptions(stops=20), rng), 0.15, rng)
    job = Job(robot="r01", logs=(Path("r01.mcap"),), target=target, settings=Settings(validate=True), out=None)
    calibration = solve(job, first_look([drive], target))
    calibration = replace(calibration, verdict=judge(calibration, drive, target))
    fleet = [replace(calibration, robot=f"r{i:03d}") for i in range(100)]
    robot_report(calibration, drive, target)  # templates are compiled once
    pages = {
        "a robot of 20 stops": timed(lambda: robot_report(calibration, drive, target)),
        "a fleet of 100": timed(lambda: fleet_report(fleet, [])),
    }
    print(f"{'page':22} {'made in s':>10} {'MB':>8} {'shown in s':>11}")
    for name, (html, seconds) in pages.items():
        print(f"{name:22} {seconds:10.3f} {len(html) / 1e6:8.3f} {shown(html):>11}")


def timed(make: Callable[[], bytes]) -> tuple[bytes, float]:
    begun = time.perf_counter()
    return make(), time.perf_counter() - begun


def shown(html: bytes) -> str:
    """Seconds from Chromium's start to an image of the page, less those for an empty page."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        return "no chromium"
    with tempfile.TemporaryDirectory() as folder:
        took = []
        for name, content in (("warm", b"<p>"), ("empty", b"<p>"), ("page", html)):
            page = Path(folder) / f"{name}.html"
            page.write_bytes(content)
            command = [chromium, *QUIET, f"--user-data-dir={folder}/profile", f"--screenshot={folder}/{name}.png"]
            begun = time.perf_counter()
            subprocess.run([*command, page.as_uri()], check=True, capture_output=True, timeout=120)
            took.append(time.perf_counter() - begun)
    return f"{max(took[2] - took[1], 0):.2f}"


if __name__ == "__main__":
    main()
