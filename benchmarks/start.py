"""What starts cost: imports, compiled code made for the first time, and read from the cache later.

python benchmarks/start.py [--installed]

Processor time of all processes, and time by the clock, of new interpreters; compiled code goes to a folder of its own.
Python's bytecode is there from the beginning, as pip writes it when it installs.
Of ``fleet-calibrate`` on one simulated robot, without and with compiled code: when its first line, the robot's first
stage and its end come. With ``--installed`` also what ``pip install .`` costs in a fresh environment, where the code is
compiled as the package is built, and how the first run goes there.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
import venv
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from boxcal.calib.simulate.cli import main as simulate_fleet
from boxcal.target.cli import main as make_target

ROOT = Path(__file__).resolve().parents[1]
FURTHER = "boxcal.calib.likelihood.compiled.compilation"
INSTALLED = "import boxcal.calib.cli, boxcal.calib.fleet.batch, boxcal.calib.one_robot.from_drives, numba"
"""What has bytecode written of all that it imports."""
STARTS = {
    "Python": "",
    "help of a command": "from boxcal.calib.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass",
    "what reads a log, imported": "import boxcal.calib.calibrate",
    "what calibrates, imported": "import boxcal.calib.calibrate, boxcal.calib.one_robot.from_drives",
    "numba, imported": "import numba",
    "compiled code, the first time": f"from {FURTHER} import prepare_all\nprepare_all(print)",
    "compiled code, later": (
        f"from boxcal.detect.alignment.compilation import compile_half\nfrom {FURTHER} import compile_all\n"
        "compile_half('all')\ncompile_all()"
    ),
}


def environment(folder: str, **more: str) -> dict[str, str]:
    """Return an environment whose compiled code and bytecode are kept in a folder."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"NUMBA_CACHE_DIR": folder, "PYTHONPYCACHEPREFIX": str(Path(folder) / "bytecode")} | more


def start(program: str, folder: str) -> tuple[float, float]:
    """Return processor time and time by the clock, s, of an interpreter that runs a program."""
    one = environment(folder, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([sys.executable, "-P", "-c", program], env=one, check=True, stdout=subprocess.DEVNULL)
    after, clock = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - begun
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, clock


def command(robots: Path, environment: dict[str, str], python: str = sys.executable) -> list[float]:
    """Return the times, s, of a command's first line, its robot's first stage and its end, and its processor time."""
    words = ["fleet-calibrate", str(robots / "r01.mcap"), "--target", str(robots / "box" / "target.json")]
    before, begun, times = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic(), []
    with subprocess.Popen(
        [python, "-P", "-u", "-m", "boxcal", *words, "--out", str(robots / "out"), "--force"],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process:  # fmt: skip
        for line in process.stdout or ():
            if not times or (len(times) == 1 and "reading" in line):
                times.append(time.monotonic() - begun)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode or len(times) < 2:
        raise SystemExit(f"fleet-calibrate ended with {process.returncode} after {len(times)} of the lines waited for")
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return [*times, time.monotonic() - begun, used]


def installed(robots: Path) -> tuple[Path, dict[str, str], float, float]:
    """Install into a fresh environment; return its Python, the environment's variables, and what that took, s."""
    place = robots / "installed"
    venv.create(place, with_pip=True)
    python, home = place / "bin" / "python", robots / "home"
    home.mkdir()
    hidden = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "PYTHONDONTWRITEBYTECODE", "PYTHONPATH", "PYTHONPYCACHEPREFIX")
    variables = {name: value for name, value in os.environ.items() if name not in hidden} | {"HOME": str(home)}
    words = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--constraint",
        str(ROOT / "constraints.txt"),
    ]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([str(python), *words, f"{ROOT}[report]"], env=variables, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return python, variables, used, time.monotonic() - begun


def commands(*, install: bool) -> None:
    """Print the times of a first and of later runs of fleet-calibrate, if wanted also of a fresh installation's."""
    print("\n| fleet-calibrate, one robot | first line | first stage | end s | processor s |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as here:
        robots = Path(here)
        with redirect_stdout(StringIO()):
            make_target([str(robots / "box")])
            simulate_fleet([here, "--robots", "1", "--stops", "20", "--frames", "6", "--moving-frames", "0"])
        compiled = str(robots / "compiled")
        start(INSTALLED, compiled)
        for name in ("first run", "later", "later again"):
            print(_row(name, command(robots, environment(compiled))), flush=True)
        if install:
            python, variables, used, clock = installed(robots)
            print(_row("first run after pip install .", command(robots, variables, str(python))), flush=True)
            print(f"\npip install '.[report]': {used:.0f} s of processor time, {clock:.0f} s by the clock")


def _row(name: str, times: list[float]) -> str:
    first, stage, end, used = times
    return f"| {name} | {first:.2f} | {stage:.2f} | {end:.1f} | {used:.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--installed", action="store_true", help="install into a fresh environment, too")
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print("| start | processor s | by the clock s |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        start(INSTALLED, folder)
        for name, program in STARTS.items():
            used, clock = start(program, folder)
            print(f"| {name} | {used:.2f} | {clock:.1f} |", flush=True)
    commands(install=options.installed)


if __name__ == "__main__":
    main()
