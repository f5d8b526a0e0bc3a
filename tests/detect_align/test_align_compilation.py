import ast
import gc
import json
import os
import subprocess
import sys
import threading
import types
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from aligned_views import TARGET, pose, view

from boxcal.detect.alignment import compilation
from boxcal.detect.alignment.backend import backend, numba_backend
from boxcal.detect.alignment.compilation import prepare
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.numba import (
    begin,
    box_refinement,
    finish,
    gauss_newton,
    homography,
    kernel,
    outlines,
    radial_camera,
    sandwich_sums,
    tag_shape,
)


def test_plain_install_runs_compiled_code():
    assert backend() is numba_backend()


def test_nothing_is_compiled_for_a_picture_beyond_what_is_prepared():
    prepare()
    kernels: tuple[Any, ...] = (
        gauss_newton._iterate,
        sandwich_sums._fill,
        begin._begin,
        finish._finish,
        box_refinement._refine,
        box_refinement._predict,
        outlines._four_sided,
        radial_camera._undistort,
        tag_shape._fill,
        homography._fit,
    )
    compilation.compile_half("all")
    prepared = [len(k.signatures) for k in kernels]  # other tests in this process may have had more compiled
    assert min(prepared) > 0
    detect_tags(view(pose(20.0)), TARGET)
    detect_tags(np.asfortranarray(view(pose(20.0))), TARGET)
    detect_tags(view(pose(20.0)) / 255, TARGET)
    kept = view(pose(20.0))
    kept.flags.writeable = False
    detect_tags(kept, TARGET)
    assert [len(k.signatures) for k in kernels] == prepared


def test_prepared_code_is_not_prepared_again(monkeypatch):
    prepare()
    monkeypatch.setattr(compilation, "compile_half", lambda _: pytest.fail("compiled twice"))
    told = []
    prepare(told.append)
    assert told == []


def test_compiled_code_needs_no_place_to_write(monkeypatch):
    monkeypatch.setattr(kernel._CONFIG, "CACHE_DIR", "/dev/null/cache")
    monkeypatch.setattr(kernel._APPDIRS, "user_cache_dir", lambda _: "/dev/null/home")
    assert kernel.cache_folder.__wrapped__() is None
    monkeypatch.setattr(kernel, "cache_folder", lambda: None)
    assert kernel.kernel()(lambda x: x + 1)(2.0) == 3.0
    told = []
    prepare(told.append)
    assert told
    assert "in memory" in told[0]


def test_code_that_is_not_compiled_runs_and_nothing_is_kept(tmp_path):
    """A folder said to be complete without code in it would be believed ever after."""
    program = "import numpy; from boxcal.detect.alignment.compilation import prepare; prepare(print); "
    program += "from boxcal.detect.alignment.numba.outlines import four_sided; "
    program += "print(len(four_sided(numpy.ones((9, 16), numpy.uint8), 1, 99)))"
    changed = {"NUMBA_DISABLE_JIT": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | changed, capture_output=True, check=True, text=True
    )
    assert done.stdout.splitlines()[-1] == "1"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("setting", ["BOUNDSCHECK", "OPT"])
def test_code_of_other_settings_of_the_compiler_is_not_taken(monkeypatch, tmp_path, setting):
    monkeypatch.setattr(kernel._CONFIG, "CACHE_DIR", str(tmp_path))
    folder = kernel.folder_for([])
    monkeypatch.setattr(kernel._CONFIG, setting, 1)
    assert kernel.folder_for([]) != folder


def test_compiled_code_is_kept_by_what_it_is_made_of(monkeypatch, tmp_path):
    monkeypatch.setattr(kernel._CONFIG, "CACHE_DIR", str(tmp_path))
    folder = kernel.cache_folder.__wrapped__()
    assert folder.parent == tmp_path
    changed = tmp_path / "source.py"
    changed.write_text("changed")
    monkeypatch.setattr(kernel, "_SOURCES", (*kernel._SOURCES, changed))
    assert kernel.cache_folder.__wrapped__() != folder


@pytest.mark.parametrize(
    ("of", "least"),
    [("detect.alignment.numba", 10), ("calib.likelihood.compiled", 1), ("calib.four_steps.compiled", 0)],
)
def test_compiled_code_is_stale_where_a_constant_in_it_has_changed(of, least):
    sources, within = import_module(f"boxcal.{of}.kernel")._SOURCES, 0
    for source in sources:
        asked = [a for a in ast.walk(ast.parse(source.read_text())) if isinstance(a, ast.ImportFrom)]
        if source.parent != sources[0].parent or source.name == "compilation.py":
            continue
        for module in [a.module for a in asked if any(name.name.isupper() for name in a.names)]:
            assert Path(find_spec(module).origin).resolve() in sources
            within += 1
    assert within >= least


@pytest.mark.parametrize(("name", "told"), [("_processor", ("another",)), ("__version__", "0")])
def test_code_for_another_processor_or_of_another_compiler_is_not_taken(monkeypatch, tmp_path, name, told):
    monkeypatch.setattr(kernel._CONFIG, "CACHE_DIR", str(tmp_path))
    folder = kernel.folder_for([])
    monkeypatch.setattr(kernel, name, (lambda: told) if name == "_processor" else told)
    assert kernel.folder_for([]) != folder


ADDS = "from boxcal.detect.alignment.numba.kernel import compiled_in\nfrom pathlib import Path\n"
ADDS += "@compiled_in(Path(FOLDER))\ndef add(x, y):\n    return x + y\n"


def _added(place, folder):
    """Return how often a function whose source lies in a place was read from a folder, and how often compiled."""
    place.mkdir()
    (place / "adding.py").write_text(ADDS.replace("FOLDER", repr(str(folder))))
    program = "import adding; assert adding.add(1.0, 2) == 3; s = adding.add.stats; "
    program += "print(sum(s.cache_hits.values()), sum(s.cache_misses.values()))"
    free = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=place, env=free, capture_output=True, check=True, text=True
    )
    return tuple(map(int, done.stdout.split()))


def test_compiled_code_is_found_by_any_copy_of_its_sources(tmp_path):
    """As after an installation anew, which writes the same sources again, or to another place."""
    assert _added(tmp_path / "first", tmp_path / "kept") == (0, 1)
    assert _added(tmp_path / "second", tmp_path / "kept") == (1, 0)


def test_installed_code_is_read_if_complete_and_never_written(monkeypatch, tmp_path):
    installed = tmp_path / "package"
    monkeypatch.setattr(kernel, "_INSTALLED", installed)
    monkeypatch.setattr(kernel._CONFIG, "CACHE_DIR", str(tmp_path / "cache"))
    elsewhere = kernel.folder_for([])
    assert elsewhere.parent == tmp_path / "cache"
    (installed / elsewhere.name).mkdir(parents=True)
    assert kernel.folder_for([]) == elsewhere
    (installed / elsewhere.name / "complete").touch()
    assert kernel.folder_for([]) == installed / elsewhere.name
    assert kernel.compiled_in(installed / elsewhere.name)(lambda x: x + 1)(2.0) == 3.0
    assert [path.name for path in (installed / elsewhere.name).iterdir()] == ["complete"]


def test_a_second_process_waits_for_the_first(tmp_path):
    told, order = [], []
    first, ready = threading.Event(), threading.Event()

    def hold():
        with compilation._locked(tmp_path / "lock", told.append):
            ready.set()
            first.wait(5)
            order.append("first")

    thread = threading.Thread(target=hold)
    thread.start()
    ready.wait(5)
    threading.Timer(0.2, first.set).start()
    with compilation._locked(tmp_path / "lock", told.append):
        order.append("second")
    thread.join()
    assert order == ["first", "second"]
    assert told == ["waiting for another process that compiles ..."]


@pytest.fixture
def further(monkeypatch, tmp_path):
    """A module with code of its own: where it is kept, and what happened."""
    folder = tmp_path / "further"
    folder.mkdir()
    module: Any = types.ModuleType("module_with_code")
    module.folder, module.calls = folder, []
    module.cache_folder = lambda: module.folder
    module.compile_all = lambda: module.calls.append((compilation._second(tmp_path).exists(), gc.isenabled()))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(compilation, "detector_folder", lambda: tmp_path)
    return module


def test_further_code_is_compiled_once_for_all_who_ask(further):
    threads = [threading.Thread(target=compilation.finish, args=(further.__name__,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(further.calls) == 1


def test_further_code_that_cannot_be_kept_is_left_to_who_calls_it(further):
    further.folder = None
    compilation.finish(further.__name__)
    assert further.calls == []


def test_helper_goes_on_with_further_code_once_the_detectors_is_there(monkeypatch, further):
    monkeypatch.setattr(compilation, "compile_half", lambda half: further.calls.append((half, gc.isenabled())))
    compilation._help([further.__name__])
    assert further.calls == [("second", False), (True, False)]
    assert gc.isenabled()


@pytest.mark.parametrize("helper_ends", [True, False], ids=["helper dies", "helper compiles"])
def test_detector_is_ready_before_further_code_is_and_without_a_helper(monkeypatch, tmp_path, further, helper_ends):
    words = ["-c", "pass" if helper_ends else "import time; time.sleep(60)"]
    done, started = [], []
    popen = subprocess.Popen

    def other(_, **options):
        started.append(popen([sys.executable, *words], **options))
        (tmp_path / "second").touch() if not helper_ends else started[0].wait()
        return started[0]

    monkeypatch.setattr(compilation, "compile_half", done.append)
    monkeypatch.setattr(subprocess, "Popen", other)
    prepare(further=[further.__name__])
    assert done == ["first", "second"]
    assert (tmp_path / "complete").exists()
    assert further.calls == []
    assert (started[0].poll() is not None) == helper_ends
    compilation._end(started[0])


def test_helper_ends_where_compiling_fails(monkeypatch, further):
    started = []
    popen = subprocess.Popen

    def other(_, **options):
        started.append(popen([sys.executable, "-c", "import time; time.sleep(60)"], **options))
        return started[0]

    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(compilation, "compile_half", interrupted)
    monkeypatch.setattr(subprocess, "Popen", other)
    with pytest.raises(KeyboardInterrupt):
        prepare()
    assert started[0].poll() is not None


def test_commands_hold_their_process_to_one_thread():
    program = (
        "from boxcal.command_line import CommandParser; CommandParser('x'); import cv2, json, numpy, scipy.linalg;"
        "from threadpoolctl import threadpool_info;"
        "print(json.dumps([cv2.getNumThreads(), *(pool['num_threads'] for pool in threadpool_info())]))"
    )
    free = {name: value for name, value in os.environ.items() if not name.endswith("_THREADS")}
    done = subprocess.run([sys.executable, "-P", "-c", program], env=free, capture_output=True, check=True, text=True)
    assert set(json.loads(done.stdout)) == {1}
