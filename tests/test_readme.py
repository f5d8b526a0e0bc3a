"""Commands of README and tutorial run as they stand there, and print what the pages say they print."""

import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()
SCRIPTS = Path(sys.executable).parent


def _module(path: str) -> ModuleType:
    """Return a program of the project that lies in no package."""
    spec = spec_from_file_location(Path(path).stem, ROOT / path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


outputs = _module("docs/site/outputs.py")


@pytest.mark.slow
def test_commands_of_readme_and_tutorial_print_what_the_pages_show(tmp_path: Path) -> None:
    """Every command of both pages, in order in one folder; `make outputs` writes anew what they print."""
    texts = {name: (ROOT / name).read_text() for name in outputs.PAGES}
    printed = outputs.run([line for t in texts.values() for line in outputs.commands(t)], tmp_path, SCRIPTS)
    ran = {line.split()[0] for line in printed}
    assert {"make-target", "measure-target", "simulate-fleet", "fleet-calibrate", "check-drive"} <= ran
    for name, text in texts.items():
        pages = outputs.shown(text)
        assert pages, name
        wrong = [f"{line}\n{d}" for line, out in pages for d in outputs.differences(out, printed[line])]
        assert not wrong, "\n".join([f"{name}:", *wrong])


@pytest.mark.slow
def test_around_an_imperfect_measured_box_robots_are_calibrated_within_0_3_percent(tmp_path: Path) -> None:
    """From make-target to check-drive around a box that is not as designed, nor exactly as measured."""
    walk = _module("tests/walk/imperfect_box.py")
    for robot, (verdict, off, passed) in walk.walk(tmp_path).items():
        assert verdict == "good", robot
        assert off <= walk.LIMIT, f"{robot}: {off:.3%}"
        assert passed, robot


_TABLE = """
robot  verdict  stops  corners
-----  -------  -----  -------
r01       good     12     2964

r01: GOOD - Put it on the robot. (18 checks passed)

wheels           rL mm           x mm
------  --------------  -------------
r01     22.193 ± 0.006  31.50 ± 0.140

error against truth    rL %  turn deg
-------------------  ------  --------
r01                  -0.043     0.019
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.140", "0.155"),  # a sigma that is a tenth too large
        ("0.006", "0.009"),
        ("± 0.006  31.50 ± 0.140", "± 0.140  31.50 ± 0.006"),  # columns exchanged
        ("22.193", "22.199"),  # an estimate that is a sigma off
        ("31.50", "31.36"),
        ("22.193 ± 0.006  31.50", "31.50 ± 0.006  22.193"),
        ("-0.043", "+0.043"),
        ("0.019", "0.023"),
        ("GOOD", "REDO"),
        (" 12 ", " 13 "),
        ("2964", "2900"),
        ("r01: GOOD - Put it on the robot. (18 checks passed)\n", ""),
    ],
)
def test_the_comparison_of_outputs_notices(old: str, new: str) -> None:
    assert not outputs.differences(_TABLE, _TABLE)
    assert not outputs.differences(_TABLE, _TABLE.replace("22.193", "22.194").replace("31.50", "31.51"))
    assert old in _TABLE
    assert outputs.differences(_TABLE, _TABLE.replace(old, new))


def test_make_targets_named_in_the_readme_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    blocks = re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL)
    names = {line.split()[1] for block in blocks for line in block.splitlines() if line.startswith("make ")}
    assert {"demo", "test"} <= names
    for name in names:
        assert re.search(rf"^{name}:", makefile, flags=re.MULTILINE), name


def test_links_to_files_lead_somewhere() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    for page in pages:
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


def test_files_that_the_pages_name_exist() -> None:
    """A file or folder named in backticks is there, by its path from the project's folder or by the end of it."""
    rooms = ("boxcal", "target", "detect", "calib", "tests", "benchmarks", "docs", "printables")
    there = [f"/{p.relative_to(ROOT).as_posix()}" for room in rooms for p in (ROOT / room).rglob("*")]
    there += [f"/{p.name}" for p in ROOT.iterdir()]
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]:
        for name in re.findall(r"`(?:python )?([\w./-]+(?:\.py|/))(?= [^`]*`|`)", page.read_text()):
            made = name.startswith(("build/", "calibration/", "dist", "box/", "seen/", "demo/", "docs/<"))
            assert made or any(path.endswith(f"/{name.rstrip('/')}") for path in there), f"{page.name}: {name}"
