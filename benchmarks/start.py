"""What starts cost: imports, compiled code made for the first time, and read from the cache later.

python benchmarks/start.py

Processor time of all processes, and time by the clock, of new interpreters; compiled code goes to a folder of its own.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time

FURTHER = "boxcal.calib.likelihood.compiled.compilation"
STARTS = {
    "Python": "",
    "help of a command": "from boxcal.calib.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass",
    "what calibrates, imported": "import boxcal.calib.calibrate",
    "numba, imported": "import numba",
    "compiled code, the first time": f"from {FURTHER} import prepare_all\nprepare_all(print)",
    "compiled code, later": (
        f"from boxcal.detect.alignment.compilation import compile_half\ncompile_half('all', ['{FURTHER}'])"
    ),
}


def start(program: str, folder: str) -> tuple[float, float]:
    """Return processor time and time by the clock, s, of an interpreter that runs a program."""
    environment = os.environ | {"NUMBA_CACHE_DIR": folder, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([sys.executable, "-P", "-c", program], env=environment, check=True, stdout=subprocess.DEVNULL)
    after, clock = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - begun
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, clock


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print("| start | processor s | by the clock s |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, program in STARTS.items():
            used, clock = start(program, folder)
            print(f"| {name} | {used:.2f} | {clock:.1f} |", flush=True)


if __name__ == "__main__":
    main()
