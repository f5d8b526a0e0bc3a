"""What is installed: one name in site-packages, beside distributions of our folders' names, and all of it."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import boxcal
from boxcal.calib.likelihood.compiled.compilation import prepare_all

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("target", "detect", "calib")
CLEAN = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV"}}
_PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
_OFFLINE = ["--no-index", "--no-deps", "--no-build-isolation"]
_INSTALL = ["install", "--no-compile"]  # Python compiles what is imported, which is little of it


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean copy of what is kept: nothing built lies in it, as in a clone."""
    copy = tmp_path_factory.mktemp("source") / "boxcal"
    for name in _kept():
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, copy / name)
    return copy


def _kept() -> list[str]:
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode or not listed.stdout:
        pytest.skip("not a clone: which files belong to the project cannot be told")
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


@pytest.fixture(scope="module")
def wheel(source: Path) -> Path:
    """The wheel as it is published, built offline from the clean copy."""
    out = source.parent / "dist"
    words = [*_OFFLINE, "--config-settings", "compile=no", "--wheel-dir", str(out), str(source)]
    subprocess.run([*_PIP, "wheel", *words], check=True, env=CLEAN)
    (built,) = out.glob("boxcal-*.whl")
    return built


@pytest.fixture
def home(tmp_path: Path) -> Iterator[Path]:
    """An environment with the libraries of this one, but without boxcal; returns its Python."""
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / ("Scripts" if os.name == "nt" else "bin") / "python"
    site = _site(python)
    # A path file's own path files are not read, so an editable boxcal of this environment stays invisible.
    (site / "libraries.pth").write_text("".join(f"{path}\n" for path in sys.path if "site-packages" in path))
    yield python
    shutil.rmtree(tmp_path / "env")


def _site(python: Path) -> Path:
    where = {"base": str(python.parents[1]), "platbase": str(python.parents[1])}
    return Path(sysconfig.get_path("purelib", vars=where))


def _install(python: Path, *what: str) -> None:
    subprocess.run([*_PIP, "--python", str(python), *_INSTALL, *_OFFLINE, *what], check=True, env=CLEAN)


def _run(python: Path, code: str) -> str:
    done = subprocess.run(
        [str(python), "-c", code], cwd=python.parent, env=CLEAN, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _importable(python: Path) -> set[str]:
    """Return the top-level names that site-packages offers for import."""
    return {
        path.name.removesuffix(".py")
        for path in _site(python).iterdir()
        if (path.is_dir() or path.suffix == ".py") and not path.name.endswith((".dist-info", "__pycache__"))
    }


def test_the_wheel_holds_every_module_and_nothing_but_boxcal(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    kept = [Path(name) for name in _kept()]
    modules = {f"boxcal/{path.as_posix()}" for path in kept if path.parts[0] in PARTS}
    modules |= {path.as_posix() for path in kept if path.parts[0] == "boxcal"}
    assert {name for name in names if ".dist-info/" not in name} == modules
    assert "boxcal/py.typed" in names


def test_a_wheel_holds_nothing_of_an_earlier_build(source: Path, tmp_path: Path) -> None:
    """The source distribution is what wheels are built from: a stale build/lib beside the sources gets into neither."""
    copy = tmp_path / "boxcal"
    shutil.copytree(source, copy, ignore=shutil.ignore_patterns("build", "*.egg-info"))
    stale = copy / "build" / "lib" / "boxcal" / "gone.py"
    stale.parent.mkdir(parents=True)
    stale.write_text("removed = True\n")
    pure = ["--no-isolation", "--config-setting", "compile=no"]
    build = [sys.executable, "-m", "build", *pure, "--outdir", str(tmp_path / "dist"), str(copy)]
    subprocess.run(build, check=True, env=CLEAN, capture_output=True)
    (built,) = (tmp_path / "dist").glob("*.whl")
    (archive,) = (tmp_path / "dist").glob("*.tar.gz")
    assert not [name for name in zipfile.ZipFile(built).namelist() if "gone" in name]
    with tarfile.open(archive) as packed:
        names = {name.partition("/")[2] for name in packed.getnames()}
    assert not [name for name in names if "gone" in name]
    assert set(_kept()) - names <= {".gitignore"}


@pytest.mark.parametrize("way", ["wheel", "editable"])
def test_only_boxcal_appears_in_site_packages(way: str, wheel: Path, source: Path, home: Path) -> None:
    _install(home, *([str(wheel)] if way == "wheel" else ["--editable", str(source)]))
    assert {name for name in _importable(home) if not name.startswith("__editable__")} <= {"boxcal"}
    said = _run(
        home,
        "import importlib.util as u, boxcal, boxcal.target.box, boxcal.detect.stops, boxcal.calib.errors\n"
        "print(boxcal.__version__, [name for name in ('target', 'detect', 'calib') if u.find_spec(name)])",
    )
    assert said.split(maxsplit=1) == [boxcal.__version__, "[]\n"]
    done = subprocess.run(
        [home.parent / "boxcal", "make-target", "box"], cwd=home.parent, env=CLEAN, capture_output=True, check=False
    )
    assert done.returncode == 0
    assert (home.parent / "box" / "target.json").is_file()


_COMPILED_AT_FIRST_USE = """
from boxcal.calib.four_steps.compiled import compilation as four_steps, damped_step, reprojection_sums
from boxcal.calib.likelihood.compiled import chain, compilation as likelihood, corner_sums, corners, legs, moved_points
from boxcal.detect.alignment import compilation as detector
from boxcal.detect.alignment.numba import box_refinement, finish, gauss_newton, sandwich_sums

likelihood.prepare_all(print)
detector.compile_half("all")
four_steps.compile_all()
likelihood.compile_all()
modules = chain, corner_sums, corners, legs, moved_points, reprojection_sums
modules += damped_step, box_refinement, finish, gauss_newton, sandwich_sums
stats = [f.stats for m in modules for f in vars(m).values() if getattr(getattr(f, "stats", None), "cache_hits", None)]
print(len(stats) > 8, sum(sum(s.cache_misses.values()) for s in stats))
"""


@pytest.mark.slow
def test_an_installation_from_sources_has_its_code_compiled(source: Path, home: Path) -> None:
    """As by `pip install .`: the first command compiles nothing, and needs no place to write."""
    prepare_all(print)  # building copies what lies in the cache
    earlier = source / "build" / "lib" / "boxcal" / "detect" / "alignment" / "numba" / "compiled" / "compiled-earlier"
    earlier.mkdir(parents=True)
    (earlier / "complete").touch()
    for _ in range(2):  # a second build meets what the first left
        _install(home, "--force-reinstall", str(source))
        (kept,) = _site(home).glob("boxcal/detect/alignment/numba/compiled")
        assert "compiled-earlier" not in {path.name for path in kept.iterdir()}
        assert len(list(kept.glob("*/complete"))) == 3
    nowhere = {"NUMBA_CACHE_DIR": "/dev/null/cache", "XDG_CACHE_HOME": "/dev/null/home", "HOME": "/dev/null"}
    done = subprocess.run(
        [str(home), "-c", _COMPILED_AT_FIRST_USE],
        cwd=home.parent,
        env=CLEAN | nowhere,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "True 0\n"


@pytest.mark.parametrize("setting", ["yes", "no", "maybe"])
def test_what_a_build_needs_is_what_compiling_needs(setting: str) -> None:
    program = "import build_backend, sys; print(*build_backend.get_requires_for_build_wheel({'compile': sys.argv[1]}))"
    words = [sys.executable, "-c", program, setting]
    done = subprocess.run(words, cwd=ROOT, env=CLEAN, capture_output=True, text=True, check=False)
    assert ("numba" in done.stdout) == (setting == "yes")
    assert (done.returncode != 0) == ("it is yes or no" in done.stderr) == (setting == "maybe")


_SCRIPT = """
import boxcal

target: boxcal.Target = boxcal.make_target(boxcal.Box(width=0.3, depth=0.3))
boxcal.save_target(target, "target.json")
drive: boxcal.Correspondences = boxcal.simulate(target=boxcal.load_target("target.json"), stops=8).correspondences
found: boxcal.Calibration = boxcal.calibrate(drive, target)
try:
    found = boxcal.calibrate(["r01.mcap", "r02.mcap"], "target.json", robot="r01")
except boxcal.BoxcalError as error:
    print(error.found, error.remedy)
yaw, pitch, roll = found.yaw_pitch_roll
pixels = found.project([[1.0, 0.0, 0.1]])
if found.verdict is not None:
    for reason in found.verdict.reasons:
        print(reason.level.value.upper(), reason.text, yaw + pitch + roll, pixels.shape)
print(found.wheels.b * 2, found.camera_matrix.sum(), found.distortion.sum(), boxcal.__version__.split("."))
"""


@pytest.mark.slow
def test_a_users_script_is_typed_against_the_installed_wheel(wheel: Path, home: Path, tmp_path: Path) -> None:
    """mypy strict finds the types of the public names in the wheel, and finds a mistake in their use."""
    _install(home, str(wheel))
    script = tmp_path / "script.py"

    def check(text: str) -> subprocess.CompletedProcess[str]:
        script.write_text(text)
        options = [
            "--strict",
            "--python-executable",
            str(home),
            "--config-file=",
            "--cache-dir",
            str(tmp_path / "cache"),
        ]
        return subprocess.run(
            [sys.executable, "-m", "mypy", *options, str(script)],
            cwd=tmp_path,
            env=CLEAN,
            capture_output=True,
            text=True,
            check=False,
        )

    done = check(_SCRIPT)
    assert done.returncode == 0, done.stdout
    wrong = check(_SCRIPT + "radius: str = found.wheels.rR\nboxcal.calibrat(drive)\n")
    assert "Incompatible types in assignment" in wrong.stdout
    assert 'Module has no attribute "calibrat"' in wrong.stdout


def test_distributions_named_as_our_folders_harm_nothing(wheel: Path, home: Path, tmp_path: Path) -> None:
    """Others' target, detect and calib, installed before and after boxcal and removed again: all work throughout."""
    others = {}
    for part in PARTS:
        project = tmp_path / part
        (project / part).mkdir(parents=True)
        (project / part / "__init__.py").write_text(f"WHO = 'another {part}'\n")
        (project / part / "cli.py").write_text("def main(): return 'theirs'\n")
        (project / "pyproject.toml").write_text(
            '[build-system]\nrequires = ["setuptools"]\nbuild-backend = "setuptools.build_meta"\n'
            f'[project]\nname = "{part}"\nversion = "9.0"\n[tool.setuptools]\npackages = ["{part}"]\n'
        )
        subprocess.run([*_PIP, "wheel", *_OFFLINE, "--wheel-dir", str(tmp_path), str(project)], check=True, env=CLEAN)
        (others[part],) = map(str, tmp_path.glob(f"{part}-9.0-*.whl"))
    _install(home, others["target"])
    _install(home, str(wheel))
    _install(home, others["detect"], others["calib"])
    ours = "import boxcal.target.cli, boxcal.detect.cli, boxcal.calib.cli, boxcal.target.box, boxcal.detect.stops\n"
    theirs = "import target, detect, calib\nassert [m.WHO for m in (target, detect, calib)] == [\n"
    _run(home, ours + theirs + "'another target', 'another detect', 'another calib']\n")
    assert _importable(home) == {"boxcal", *PARTS}
    subprocess.run([*_PIP, "--python", str(home), "uninstall", "--yes", *PARTS], check=True, env=CLEAN)
    _run(home, ours)
    assert _importable(home) == {"boxcal"}


@pytest.mark.slow
def test_the_wheel_alone_installs_and_every_command_answers(wheel: Path, tmp_path: Path) -> None:
    """The wheel and what it asks for in an empty environment: every command answers, and finds all that it imports."""
    venv.create(tmp_path / "empty", with_pip=True)
    python = tmp_path / "empty" / ("Scripts" if os.name == "nt" else "bin") / "python"
    subprocess.run(
        [str(python), *_PIP[1:], *_INSTALL, "--constraint", str(ROOT / "constraints.txt"), str(wheel)],
        check=True,
        env=CLEAN,
    )
    scripts: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    for script in scripts:
        done = subprocess.run(
            [str(python.parent / script), "--help"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env=CLEAN,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert script in done.stdout
    modules = {place.split(":")[0] for place in scripts.values()}
    _run(python, f"import {', '.join(sorted(modules))}, boxcal.calib.fleet.batch, boxcal.target.print.sheets")


@pytest.mark.skipif(shutil.which("hadolint", path=str(Path(sys.executable).parent)) is None, reason="no hadolint here")
def test_the_container_is_described_as_its_linter_wants() -> None:
    hadolint = Path(sys.executable).parent / "hadolint"
    done = subprocess.run([hadolint, ROOT / "Dockerfile"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), flags=re.MULTILINE)
    newest = re.search(r"^## (\S+) - ", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    assert citation is not None
    assert newest is not None
    assert citation[1] == newest[1] == project["version"] == boxcal.__version__


def test_the_metadata_names_each_python_that_is_supported() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    least = int(project["requires-python"].rpartition(".")[2])
    named = {int(c.rpartition(".")[2]) for c in project["classifiers"] if re.search(r":: 3\.\d+$", c)}
    assert named == set(range(least, max(named) + 1))
    assert {11, 12, 13} <= named
    assert project["authors"]
    assert project["urls"]
