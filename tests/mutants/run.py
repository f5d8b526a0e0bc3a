"""Seed bugs into a copy of the project, run the tests that must notice, and print which bugs survive.

    python tests/mutants/run.py                        all bugs of seeded.toml
    python tests/mutants/run.py reml_dof start_yaw     some of them
    python tests/mutants/run.py --sampled 3            3 random changes to each file of calib/four_steps and likelihood

The working tree is not touched. Exit status: 1 if seeded bugs survive, 2 if a test fails already without any bug or a
bug's text has gone. Random changes that survive are only printed: many of them change nothing that matters.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from sampled import sampled_mutants
from seeded import ROOT, Mutant, seeded_mutants

PARTS = ("boxcal", "target", "detect", "calib")
BESIDE = ("tests", "benchmarks", "docs", "printables", "pyproject.toml", "README.md", "Makefile", "constraints.txt")
TIME_LIMIT_S = 900
"""A bug that makes a test run on and on is noticed, too."""


@contextmanager
def copied_project() -> Iterator[Path]:
    """Yield a copy of the project that imports as ``boxcal``, with shared/ beside it where there is one."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Path(folder) / "project"
        for name in PARTS + BESIDE:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("*.pyc", "*.tmp"))
            elif source.exists():
                shutil.copy2(source, copy / name)
        package = copy / "build" / "tree" / "boxcal"
        package.mkdir(parents=True)
        for part in PARTS[1:]:
            (package / part).symlink_to(copy / part)
        for file in (copy / "boxcal").iterdir():
            (package / file.name).symlink_to(file)
        shared = (ROOT / ".." / "shared").resolve()
        if shared.is_dir():
            (Path(folder) / "shared").symlink_to(shared)
        yield copy


def passes(copy: Path, tests: Sequence[str]) -> tuple[bool, str]:
    """Run tests in the copy; return whether all passed, and the first that did not."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(copy / "build" / "tree"),
        "PYTHONDONTWRITEBYTECODE": "1",  # compiled code of one bug must not serve the next
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-P", "-m", "pytest", "-x", "-q", "--no-header", "-p", "no:randomly", *tests]
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return False, f"still running after {TIME_LIMIT_S} s"
    if done.returncode not in {0, 1, 2}:  # 2: a test file that cannot be imported
        raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return done.returncode == 0, failed[0].split(" - ")[0] if failed else ""


def survivors(mutants: Sequence[Mutant]) -> list[Mutant]:
    """Print for each mutant whether its tests notice it, and return those that they do not."""
    out = []
    with copied_project() as copy:
        for mutant in mutants:
            mutant.apply((copy / mutant.file).read_text())  # before any test runs: each still has its place
        sound, failed = passes(copy, sorted({test for m in mutants for test in m.tests}))
        if not sound:
            raise ValueError(f"the tests fail without any bug: {failed}")
        for mutant in mutants:
            path = copy / mutant.file
            text = path.read_text()
            path.write_text(mutant.apply(text))
            try:
                unnoticed, by = passes(copy, mutant.tests)
            finally:
                path.write_text(text)
            print(f"{'SURVIVED' if unnoticed else 'KILLED  '}  {mutant.name:32} {mutant.file}  {by}", flush=True)
            if unnoticed:
                print(f"    - {mutant.old}\n    + {mutant.new}", flush=True)
                out.append(mutant)
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Run the mutants that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="bugs of seeded.toml (all)")
    parser.add_argument("--sampled", type=int, metavar="N", help="N random changes a file instead of the seeded bugs")
    parser.add_argument("--seed", type=int, default=1, help="of the random changes (1)")
    parser.add_argument("--files", nargs="*", help="files that random changes are made to")
    options = parser.parse_args(argv)
    try:
        if options.sampled:
            chosen = sampled_mutants(options.sampled, options.seed, options.files)
        else:
            chosen = seeded_mutants()
            unknown = set(options.names) - {m.name for m in chosen}
            if unknown:
                raise ValueError(f"no seeded bug is named {', '.join(sorted(unknown))}")
            chosen = tuple(m for m in chosen if not options.names or m.name in options.names)
        alive = survivors(chosen)
    except (ValueError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{len(chosen) - len(alive)} of {len(chosen)} bugs were noticed")
    return 1 if alive and not options.sampled else 0


if __name__ == "__main__":
    sys.exit(main())
