"""The box's models in the parsers of Gazebo (libsdformat, Debian), Blender (Debian) and librsvg."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from boxcal.target.box import Target, make_target
from boxcal.target.models.obj import box_obj
from boxcal.target.models.sdf import SDF_NAME, box_sdf

LOADER = """
#include <iostream>
#include <sdf/sdf.hh>
int main(int, char **words) {
  sdf::Root root;
  for (const auto &error : root.Load(words[1])) std::cerr << error.Message() << "\\n";
  if (!root.Model()) return 1;
  const auto *link = root.Model()->LinkByIndex(0);
  std::cout << root.Model()->Name() << " " << link->VisualCount() << " " << link->CollisionCount() << "\\n";
}
"""
LOOK = """
import bpy, json, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
path, out = sys.argv[-2:]
bpy.ops.wm.obj_import(filepath=path) if hasattr(bpy.ops.wm, "obj_import") else bpy.ops.import_scene.obj(filepath=path)
points = [list(o.matrix_world @ v.co) for o in bpy.data.objects if o.type == "MESH" for v in o.data.vertices]
open(out, "w").write(json.dumps([[min(c) for c in zip(*points)], [max(c) for c in zip(*points)]]))
"""


def written(files: dict[str, bytes], folder: Path) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


@pytest.fixture(scope="module")
def target() -> Target:
    return make_target()


def test_libsdformat_loads_the_model_without_a_complaint(target: Target, tmp_path: Path) -> None:
    tools = [shutil.which(name) for name in ("g++", "pkg-config")]
    asked = ["pkg-config", "--cflags", "--libs", "sdformat12"]
    flags = subprocess.run(asked, capture_output=True, text=True, check=False) if all(tools) else None
    if flags is None or flags.returncode:
        pytest.skip("libsdformat is not installed (apt-get install libsdformat-dev g++ pkg-config)")
    written(dict(box_sdf(target)), tmp_path)
    (tmp_path / "loader.cc").write_text(LOADER)
    build = ["g++", "-std=c++17", "loader.cc", "-o", "loader", *flags.stdout.split()]
    subprocess.run(build, cwd=tmp_path, check=True, timeout=240)
    done = subprocess.run(
        ["./loader", tmp_path / "model.sdf"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    assert done.stdout.split() == [SDF_NAME, "1", "1"]


def test_blender_shows_the_box_upright_and_in_metres(target: Target, tmp_path: Path) -> None:
    blender = shutil.which("blender")
    if blender is None:
        pytest.skip("Blender is not installed (apt-get install blender)")
    files = dict(box_obj(target))
    written(files, tmp_path)
    (tmp_path / "look.py").write_text(LOOK)
    (mesh,) = [name for name in files if name.endswith(".obj")]
    words = [
        blender,
        "--background",
        "--factory-startup",
        "--python-exit-code",
        "1",
        "--python",
        str(tmp_path / "look.py"),
    ]
    done = subprocess.run(
        [*words, "--", str(tmp_path / mesh), str(tmp_path / "out.json")],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert not done.returncode, done.stdout + done.stderr
    low, high = np.array(json.loads((tmp_path / "out.json").read_text()))
    assert high - low == pytest.approx([target.box.width, target.box.depth, target.box.height], abs=1e-4)
    assert low[2] == pytest.approx(0, abs=1e-4), "it stands on the floor, z up"
