"""Size and times of the fleet's page, in headless Chromium.

    python benchmarks/fleet_page.py --robots 5000

prints the page's size, the time to make it, to its first view (from opening it until its table is drawn) and until
all charts are, and from a sort, a filter, a turned page, a choice of the plot until the screen shows the answer: the
longest of several. On a busy machine the main thread's processor time is what can be compared.
"""

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "report"))

from browser import Browser

import boxcal
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.report.fleet import fleet_report
from boxcal.calib.results.calibration import Calibration

GOALS = {"first view": 2.0, "sort": 0.1, "filter": 0.1, "page": 0.1, "plot": 0.1}
MOST_BYTES = 5e6
REVISIONS = ("rev A", "rev B", "rev C")
TIMED = """(async () => {{ const t = performance.now(); {act};
  await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));
  document.body.getBoundingClientRect(); return performance.now() - t; }})()"""
SORT = 'document.querySelectorAll("#robot-table thead button")[%d].click()'
FILTER = '(() => {{ const f = document.getElementById("%s"); f.value = "%s"; f.dispatchEvent(new Event("%s")); }})()'


def made_up(one: Calibration, robots: int, rng: np.random.Generator) -> list[Calibration]:
    """Return calibrations of a fleet like one robot, of three hardware revisions with a few outliers."""
    found = []
    for i in range(robots):
        kind = int(rng.integers(len(REVISIONS)))
        r = one.wheels.rR * (1 + 0.02 * kind) * (1 + 0.002 * rng.normal(size=2))
        b = one.wheels.b * (1 + 0.001 * rng.normal()) * (1.1 if i % 400 == 7 else 1.0)
        camera = replace(one.camera, fu=one.camera.fu + rng.normal(), fv=one.camera.fv + rng.normal())
        T = one.T_body_cam @ rigid(exp_so3(0.01 * rng.normal(size=3)), 0.001 * rng.normal(size=3))
        settings = {**one.provenance.settings, "hardware": REVISIONS[kind]}
        found.append(
            replace(
                one,
                robot=f"robot-{i:04d}",
                camera=camera,
                wheels=replace(one.wheels, rR=float(r[0]), rL=float(r[1]), b=float(b)),
                T_body_cam=T,
                provenance=replace(one.provenance, settings=settings),
            )
        )
    return found


Times = dict[str, tuple[float, float]]
"""Processor time of the page's main thread, and time by the clock, s."""


def busy(browser: Browser) -> float:
    """Return the processor time, s, that the page's main thread has worked since it was asked to count."""
    found = {m["name"]: m["value"] for m in browser.send("Performance.getMetrics")["metrics"]}
    return float(found["TaskDuration"])


def measured(page: Path, browser: Browser) -> Times:
    """Return the times of a fleet's page: its first view, and the longest of several sorts, filters, pages, plots."""
    browser.open("about:blank")
    browser.send("Performance.enable", timeDomain="threadTicks")
    begun, before = time.perf_counter(), busy(browser)
    browser.send("Page.navigate", url=page.as_uri())
    drawn = "document.readyState === 'complete' && document.querySelectorAll('#robot-table tbody tr').length > 0"
    wait(browser, drawn)
    browser.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
    out: Times = {"first view": (busy(browser) - before, time.perf_counter() - begun)}
    wait(browser, "document.querySelectorAll('#spread-charts svg').length >= 14")
    out["all drawn"] = (busy(browser) - before, time.perf_counter() - begun)

    def longest(*acts: str) -> tuple[float, float]:
        times = []
        for act in acts:
            before = busy(browser)
            clock = browser.evaluate(TIMED.format(act=act)) / 1e3
            times.append((busy(browser) - before, clock))
        return max(t[0] for t in times), max(t[1] for t in times)

    out["sort"] = longest(*(SORT % k for k in (0, 0, 3, 7, 7, 9, 20)))
    out["filter"] = longest(
        *(FILTER.format() % ("filter-text", word, "input") for word in ("r", "robot-1", "robot-12", "robot-123", "")),
        FILTER.format() % ("filter-hardware", REVISIONS[1], "change"),
        FILTER.format() % ("filter-hardware", "*", "change"),
    )
    if browser.evaluate("!!document.querySelector('.pager:not([hidden])')"):
        out["page"] = longest('document.querySelectorAll(".pager button")[1].click()')
    out["plot"] = longest(*(FILTER.format() % ("plot-y", str(k), "change") for k in (2, 4, 16)))
    return out


def wait(browser: Browser, condition: str) -> None:
    deadline = time.monotonic() + 60
    while not browser.evaluate(condition):
        if time.monotonic() > deadline:
            raise TimeoutError(condition)
        time.sleep(0.01)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=5000)
    parser.add_argument("--keep", type=Path, help="folder for the page and pictures of it")
    args = parser.parse_args(argv)
    chromium = next((p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None)
    if chromium is None:
        print("no chromium on this machine", file=sys.stderr)
        return 1
    simulated = boxcal.simulate(stops=12, seed=1)
    one = boxcal.calibrate(simulated.correspondences, simulated.target)
    robots = made_up(one, args.robots, np.random.default_rng(1))
    begun = time.process_time()
    content = fleet_report(robots, [])
    print(f"{args.robots} robots, made in {time.process_time() - begun:.1f} s of processor time")
    with tempfile.TemporaryDirectory() as name:
        page = (args.keep or Path(name)) / "fleet.html"
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_bytes(content)
        profile = Path(name) / "chromium"
        profile.mkdir()
        with Browser(chromium, profile) as browser:
            found = measured(page, browser)
            for kind, width, dark in (
                ("desktop", 1280, False),
                ("tablet", 768, False),
                ("phone", 390, False),
                ("dark", 1280, True),
            ):
                if args.keep:
                    browser.open(page, width=width, dark=dark)
                    time.sleep(1)
                    browser.screenshot(args.keep / f"{kind}.png")
    print(f"size {len(content) / 1e6:.2f} MB (goal {MOST_BYTES / 1e6:.0f} MB)")
    for name, (processor, clock) in found.items():
        goal = f"  (goal {GOALS[name] * 1e3:.0f} ms)" if name in GOALS else ""
        print(f"{name:<11} {processor * 1e3:5.0f} ms of processor time, {clock * 1e3:5.0f} ms by the clock{goal}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
