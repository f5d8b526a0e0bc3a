"""The README's commands run as they stand there, and print what it says they print."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()
SCRIPTS = Path(sys.executable).parent


def _shell_lines() -> list[str]:
    blocks = re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line.strip() and not line.startswith("#")]


def _run(line: str, folder: Path) -> str:
    path = f"{SCRIPTS}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", line], cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{line}: {done.stderr}"
    return done.stdout


def _numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?![\w.])", text)]


@pytest.mark.slow
def test_the_readme_commands_run_in_order_and_print_what_it_shows(tmp_path: Path) -> None:
    printed = {line: _run(line, tmp_path) for line in _shell_lines() if not line.startswith("make ")}
    assert {"make-target", "simulate-fleet", "fleet-calibrate"} <= {shlex.split(line)[0] for line in printed}
    shown = re.findall(r"<!-- output of: (.*?) -->\n```text\n(.*?)```", README, flags=re.DOTALL)
    assert shown
    for line, text in shown:
        found = printed[line].strip().splitlines()
        wanted = text.strip().splitlines()
        assert [re.sub(r"[-+\d.]+", "#", w).split() for w in wanted] == [
            re.sub(r"[-+\d.]+", "#", f).split() for f in found
        ], line
        # The same versions of the libraries give the same numbers; others may differ in the last digits.
        assert np.allclose(_numbers(text), _numbers(printed[line]), rtol=0.02, atol=0.1)


def test_make_targets_named_in_the_readme_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    names = {line.split()[1] for line in _shell_lines() if line.startswith("make ")}
    assert {"demo", "test"} <= names
    for name in names:
        assert re.search(rf"^{name}:", makefile, flags=re.MULTILINE), name


def test_links_to_files_lead_somewhere() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    for page in pages:
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


def test_files_that_the_pages_name_exist() -> None:
    """A file named in backticks is there, from the project's folder or from the one that the page is about."""
    here = {"docs/detector.md": ROOT / "detect/alignment", "docs/method.md": ROOT / "calib/likelihood"}
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]:
        about = here.get(page.relative_to(ROOT).as_posix(), ROOT)
        for name in re.findall(r"`(?:python )?([\w./-]+(?:\.py|/))(?= [^`]*`|`)", page.read_text()):
            made = name.startswith(("build/", "dist", "box/", "seen/", "demo/", "docs/<"))
            assert made or (ROOT / name).exists() or (about / name).exists(), f"{page.name}: {name}"
