"""What holds for the project as a whole: how imports run, and that its commands work where only the wheel is."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import boxcal
import boxcal.__main__ as umbrella

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("target", "detect", "calib")


def test_every_folder_of_modules_is_installed() -> None:
    """The packages that pyproject.toml lists are those that there are: none is forgotten in the wheel."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    there = {
        ".".join(("boxcal", *init.parent.relative_to(ROOT).parts))
        for p in PARTS
        for init in (ROOT / p).rglob("__init__.py")
    }
    assert sorted(listed) == sorted(there | {"boxcal"})
    for part in PARTS:
        for module in (ROOT / part).rglob("*.py"):
            assert (module.parent / "__init__.py").is_file(), f"{module.relative_to(ROOT)} lies in no package"


def test_no_module_is_imported_by_another_name_than_boxcal() -> None:
    for part in PARTS:
        for path in (ROOT / part).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    assert not {alias.name.split(".")[0] for alias in node.names} & set(PARTS), path
                elif isinstance(node, ast.ImportFrom):
                    assert node.level == 0, f"{path}: relative import"
                    assert (node.module or "").split(".")[0] not in PARTS, path


def test_only_the_edges_of_calib_touch_files() -> None:
    """Nothing in calib but fleet, results, simulation, the guide and the command line opens a file."""
    edges = {"batch.py", "writing.py", "json_format.py", "ground_truth.py", "cli.py"}
    for path in (ROOT / "calib").rglob("*.py"):
        inner = path.relative_to(ROOT / "calib")
        if inner.parts[0] in {"simulate", "exports", "report", "fleet", "console", "guide"} or inner.name in edges:
            continue
        calls = re.findall(
            r"\bopen\(|\.read_(?:text|bytes)\(|\.write_(?:text|bytes)\(|write_atomically\(|\bprint\(", path.read_text()
        )
        assert not calls, f"{inner}: {calls}"


def _scripts() -> dict[str, str]:
    scripts: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    return scripts


@pytest.mark.parametrize("script", _scripts())
def test_help_is_answered_without_heavy_imports(script: str) -> None:
    """`--help` answers at once: none of the numeric, image or PDF libraries is loaded for it."""
    module, function = _scripts()[script].split(":")
    code = (
        f"import sys\nsys.argv = [{script!r}, '--help']\nfrom {module} import {function}\n"
        f"try:\n    {function}()\nexcept SystemExit as leave:\n    assert not leave.code\n"
        "heavy = {'numpy', 'scipy', 'cv2', 'reportlab', 'mcap', 'rosbags'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    assert "example" in done.stdout


@pytest.mark.parametrize("script", _scripts())
def test_every_command_tells_its_version(script: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = import_module(_scripts()[script].split(":")[0])
    with pytest.raises(SystemExit) as leave:
        command.main(["--version"])
    assert not leave.value.code
    assert capsys.readouterr().out == f"boxcal {boxcal.__version__}\n"


def test_the_umbrella_runs_every_installed_command_and_its_short_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(umbrella.COMMANDS) == set(_scripts()) - {"boxcal"}
    assert set(umbrella.SHORT.values()) <= set(umbrella.COMMANDS)
    for name in [*umbrella.COMMANDS, *umbrella.SHORT]:
        script = umbrella.SHORT.get(name, name)
        assert _scripts()[script] == f"{umbrella.COMMANDS[script][0]}:main"
        with pytest.raises(SystemExit) as leave:
            umbrella.main(["help", name])
        assert not leave.value.code
        assert f"usage: {script}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["calibrat"], "did you mean calibrate?"),
        (["make-targets"], "did you mean make-target?"),
        (["calibrate", "a.mcap", "--sameroot"], "did you mean --same-robot?"),
        (["simulate", "robots", "--slipp=0.1"], "did you mean --slip?"),
        (["detect", "a.png", "--tone", "sgrb"], "did you mean srgb?"),
        (["detect", "--helo"], "did you mean --help?"),
        (["compare", "a.json", "--levl=0.1"], "did you mean --level?"),
    ],
)
def test_mistyped_words_are_answered_with_the_one_that_was_meant(
    words: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as leave:
        umbrella.main(words)
    assert leave.value.code == 2
    assert meant in capsys.readouterr().err


def test_constraints_name_packages_and_versions_only() -> None:
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert re.fullmatch(r"(#.*|[A-Za-z0-9._-]+==[A-Za-z0-9.+!]+)?", line), line
