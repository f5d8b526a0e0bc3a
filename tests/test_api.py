"""The public interface: its examples run, its names are typed, and importing it costs nothing."""

import ast
import doctest
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest

import boxcal
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.simulate.cli import main as simulate_fleet
from boxcal.detect.log.wheel_samples import JointUnit
from boxcal.target.camera.distortion import CameraKind
from boxcal.target.render.renderer import render
from boxcal.target.render.sensor import SensorModel

ROOT = Path(__file__).resolve().parents[1]
CALLABLES = [name for name in boxcal.__all__ if not name.startswith("__")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the examples find where they run: a simulated robot's log, and a photograph of the box."""
    here = tmp_path_factory.mktemp("examples")
    options = ["--robots", "1", "--stops", "5", "--seed", "1", "--frames", "1", "--moving-frames", "0"]
    assert simulate_fleet([str(here / "robots"), *options]) == 0
    seen = boxcal.simulate(stops=3)
    T_cam_box = inverse(seen.drive.T_box_cam[0])
    photo = render(
        seen.target, seen.robot.camera, T_cam_box, seen.robot.image_size, SensorModel(), np.random.default_rng(0)
    )
    cv2.imwrite(str(here / "photo.png"), photo)
    boxcal.save_target(seen.target, here / "box" / "target.json")
    drive = boxcal.simulate(stops=8, seed=1)
    boxcal.save_calibration(boxcal.calibrate(drive.correspondences), here / "calibration" / "r01" / "calibration.json")
    return here


def _examples() -> list[doctest.DocTest]:
    finder = doctest.DocTestFinder(recurse=False)
    found = finder.find(boxcal, "boxcal", module=False, globs={})
    for name in CALLABLES:
        found += finder.find(getattr(boxcal, name), name, module=False, globs={})
    return [example for example in found if example.examples]


@pytest.mark.parametrize("example", _examples(), ids=lambda example: example.name)
def test_examples_of_the_public_interface_run(
    example: doctest.DocTest, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    report: list[str] = []
    runner.run(example, out=report.append, clear_globs=False)
    assert not runner.failures, "".join(report)


@pytest.mark.parametrize("page", ["README.md", "docs/api.md"])
def test_python_in_the_pages_runs(page: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, page, "exec"), {})


def test_every_public_function_has_an_example() -> None:
    with_example = {example.name for example in _examples()}
    functions = {name for name in CALLABLES if name[0].islower()}
    assert functions | {"boxcal", "Calibration"} <= with_example


def test_public_names_are_what_type_checkers_are_told() -> None:
    """The names under TYPE_CHECKING, those loaded on first use and ``__all__`` are the same, from the same modules."""
    tree = ast.parse(Path(boxcal.__file__).read_text())
    told = {
        alias.asname: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname
    }
    assert told == boxcal._HOME
    assert sorted(boxcal.__all__) == sorted([*told, "__version__"])
    for name, module in told.items():
        assert getattr(boxcal, name) is getattr(import_module(str(module)), name)
    assert set(boxcal.__all__) <= set(dir(boxcal))


def test_importing_loads_nothing_else() -> None:
    code = "import sys, boxcal\nprint([m for m in sys.modules if m.startswith('boxcal') or m in ('numpy', 'cv2')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['boxcal']"


def test_calibrating_loads_no_large_library_for_a_small_thing() -> None:
    """scipy's statistics and spatial transforms take as long to import as all the rest."""
    code = (
        "import sys, boxcal.calib.calibrate; print([m for m in ('scipy.stats', 'scipy.spatial') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_log_begins_to_be_read_before_what_solves_it_is_loaded() -> None:
    code = (
        "import sys, boxcal.calib.fleet.batch, boxcal.calib.fleet.results_place, boxcal.calib.calibrate\n"
        "calib = ('likelihood.estimator', 'one_robot.writing', 'report')\n"
        "late = ('scipy', *('boxcal.calib.' + m for m in calib))\n"
        "print([m for m in late if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_name_that_there_is_not_is_said() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        boxcal.no_such_name  # type: ignore[attr-defined]  # noqa: B018


def test_the_documentation_of_the_interface_is_complete() -> None:
    page = (ROOT / "docs" / "api.md").read_text()
    assert sorted(re.findall(r"^::: boxcal\.(\w+)$", page, flags=re.MULTILINE)) == sorted(CALLABLES)


def test_settings_take_members_of_enumerations_by_their_names_and_refuse_others() -> None:
    """A string that passed for no member would be taken for whatever comes last in a chain of comparisons."""
    settings = boxcal.Settings(lens="brown", moving="off", camera_mode="per-stop")  # type: ignore[arg-type]
    assert settings == boxcal.Settings(lens=CameraKind.BROWN, moving=Moving.OFF, camera_mode=CameraMode.PER_STOP)
    assert (settings.lens, settings.moving, settings.camera_mode) == ("brown", "off", "per-stop")
    assert settings.moving is Moving.OFF
    assert boxcal.WheelUnits(unit="ticks", ticks_per_turn=100.0).unit is JointUnit.TICKS  # type: ignore[arg-type]
    with pytest.raises(boxcal.BoxcalError, match="moving is never, one of auto, off, on is needed"):
        boxcal.Settings(moving="never")  # type: ignore[arg-type]
    with pytest.raises(boxcal.BoxcalError, match="unit is inches, one of deg, m, rad, ticks, turns is needed"):
        boxcal.WheelUnits(unit="inches")  # type: ignore[arg-type]


def test_one_camera_is_not_quietly_chosen_where_the_settings_ask_for_several() -> None:
    drive = boxcal.simulate(stops=4, seed=1).correspondences
    for settings in (boxcal.Settings(all_cameras=True), boxcal.Settings(cameras=("/front", "/rear"))):
        with pytest.raises(boxcal.BoxcalError, match="the settings ask for several cameras"):
            boxcal.calibrate(drive, settings=settings)
