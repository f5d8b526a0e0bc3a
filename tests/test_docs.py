"""The documentation builds without a warning from docs/ and the docstrings; a dead link fails it."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

pytestmark = [
    pytest.mark.skipif(find_spec("mkdocstrings") is None, reason="the extra docs is not installed"),
    pytest.mark.slow,
]


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of what the documentation is built from."""
    for name in ("boxcal", "target", "detect", "calib", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("mkdocs.yml", "Makefile", *(path.name for path in ROOT.glob("*.md"))):
        shutil.copyfile(ROOT / name, tmp_path / name)
    subprocess.run(["make", "-s", "build/tree"], cwd=tmp_path, check=True)
    return tmp_path


def test_the_documentation_builds_needs_no_network_and_fails_for_a_dead_link_alone(project: Path) -> None:
    """One build for all: with a dead link, which is the only thing that is wrong with it."""
    method = project / "docs" / "method.md"
    method.write_text(method.read_text() + "\n[gone](no-such-page.md)\n")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict"],
        cwd=project,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    (warning,) = [line for line in done.stderr.splitlines() if line.startswith(("WARNING", "ERROR"))]
    assert "no-such-page.md" in warning
    pages = list((project / "build" / "docs").rglob("*.html"))
    for room in ("target", "detect", "calib.four_steps"):
        page = (project / "build" / "docs" / "rooms" / f"boxcal.{room}.html").read_text()
        assert page.count('class="doc doc-') > 20, f"the docstrings of {room} were not found"
    loaded = {
        url
        for page in pages
        for url in re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="(https?://[^"]+)"', page.read_text())
    }
    assert not loaded
