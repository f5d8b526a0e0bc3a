"""Code of an older commit, run beside today's: taken out of the repository, in a process of its own."""

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BEFORE = "c270e30^"
"""Last commit before lean, the target as built and the choice of a camera model became part of the likelihood."""


@contextmanager
def older_tree(commit: str) -> Iterator[Path]:
    """Give a folder with the tree of a commit (``git archive``)."""
    with tempfile.TemporaryDirectory() as folder:
        archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
        with tarfile.open(fileobj=BytesIO(archive)) as tree:
            tree.extractall(folder, filter="data")
        for package in ("target", "detect", "calib"):
            (Path(folder) / "boxcal" / package).symlink_to(Path(folder) / package)
        yield Path(folder)


def printed(code: str, tree: Path) -> Any:
    """Return what code prints last, as JSON, when it is run in a tree."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], cwd=tree, env=environment, check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout.splitlines()[-1])
