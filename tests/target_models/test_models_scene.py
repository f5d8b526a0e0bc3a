"""Simulator models, read by loaders that know nothing of this project."""

import io
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from boxcal.target.arrays import Array
from boxcal.target.box import Box, Target, make_target
from boxcal.target.models.glb import box_glb
from boxcal.target.models.mjcf import box_mjcf
from boxcal.target.models.obj import box_obj
from boxcal.target.models.sdf import box_sdf
from boxcal.target.tags.families import modules_per_side, tag_modules

SMALL = Box(width=0.131, depth=0.152, height=0.0937, columns=3, rows=2, tag_size=0.0301, pitch=0.0367, first_id=40)
WIDTH, HEIGHT, FOCAL_PX = 1280, 960, 1100.0
FINER = 2
"""Other renderers draw this many times finer; their pixels are then averaged."""
VIEWS = [
    ("default", "front"),
    ("default", "back"),
    pytest.param("built wrong", "corner", marks=pytest.mark.slow),
    pytest.param("built wrong", "back", marks=pytest.mark.slow),
]
BOX_GLTF = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Maps glTF's axes (y up) to frame ``box``."""


def load_glb(content: bytes) -> Any:
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.load(io.BytesIO(content), file_type="glb")
    scene.apply_transform(np.block([[BOX_GLTF, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
    return scene


def load_obj(files: Mapping[str, bytes], folder: Path, *, y_up: bool) -> Any:
    trimesh = pytest.importorskip("trimesh")
    for name, content in files.items():
        (folder / name).write_bytes(content)
    scene = trimesh.load(folder / "box.obj", force="scene")
    if y_up:
        scene.apply_transform(np.block([[BOX_GLTF, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
    return scene


def grey_at(scene: Any, p_box: Array) -> Array:
    """The texture's grey at points (N, 3) on the model's pictures, 0 to 255; NaN elsewhere."""
    found = np.full(len(p_box), np.nan)
    for part in scene.dump():
        material = part.visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        if image is None:
            continue
        grey = np.asarray(image.convert("L"))
        middle = part.vertices.mean(axis=0)
        normal = np.linalg.svd(part.vertices - middle)[2][2]
        on = np.abs((p_box - middle) @ normal) < 2e-6
        on &= np.all((p_box > part.bounds[0] - 1e-6) & (p_box < part.bounds[1] + 1e-6), axis=1)
        uv = (p_box[on] - middle) @ (
            np.linalg.pinv(part.vertices - middle) @ (part.visual.uv - part.visual.uv.mean(axis=0))
        )
        uv += part.visual.uv.mean(axis=0)
        column, row = uv[:, 0] * grey.shape[1], (1 - uv[:, 1]) * grey.shape[0]
        found[on] = grey[np.floor(row).astype(int), np.floor(column).astype(int)]
    return found


def module_points(target: Target, tag_id: int) -> Array:
    """Points (M, M, 3) in the middle of a tag's modules."""
    corners = target.tag_corners[target.row_of(tag_id)]
    modules = modules_per_side(target.box.dictionary)
    steps = (np.arange(modules) + 0.5) / modules
    right, down = corners[1] - corners[0], corners[3] - corners[0]
    return np.asarray(corners[0] + steps[None, :, None] * right + steps[:, None, None] * down)


READERS: dict[str, Callable[[Target, Path], Any]] = {
    "glb": lambda target, _: load_glb(box_glb(target)),
    "obj": lambda target, folder: load_obj(box_obj(target), folder, y_up=True),
    "sdf": lambda target, folder: load_obj(
        {k.removeprefix("meshes/"): v for k, v in box_sdf(target).items() if k.startswith("meshes/")},
        folder,
        y_up=False,
    ),
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("case", ["small", "built wrong"])
def test_every_module_shows_on_the_model_where_the_target_says(
    kind: str, case: str, wrong_target: Target, tmp_path: Path
) -> None:
    target = make_target(SMALL) if case == "small" else wrong_target
    scene = READERS[kind](target, tmp_path)
    chosen = target.tag_ids if case == "small" else target.tag_ids[::7]
    points = np.concatenate([module_points(target, int(tag)).reshape(-1, 3) for tag in chosen])
    wanted = np.concatenate([tag_modules(target.box.dictionary, int(tag)).ravel() for tag in chosen])
    grey = grey_at(scene, points)
    assert not np.isnan(grey).any(), "a point of a tag is not on the model"
    assert np.array_equal(grey > 127, wanted)


@pytest.mark.parametrize("kind", READERS)
def test_the_outline_is_that_of_the_figures(kind: str, tmp_path: Path) -> None:
    scene = READERS[kind](make_target(SMALL), tmp_path)
    half = np.array([SMALL.width / 2, SMALL.depth / 2])
    assert scene.bounds == pytest.approx(np.array([[*-half, 0], [*half, SMALL.height]]), abs=1e-7)
    mesh = pytest.importorskip("trimesh").util.concatenate(scene.dump())
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(SMALL.width * SMALL.depth * SMALL.height, rel=1e-6)


@pytest.mark.parametrize(("case", "view"), VIEWS)
def test_another_renderer_sees_the_glb_as_ours_does(  # noqa: PLR0917 - fixtures
    case: str,
    view: str,
    wrong_target: Target,
    poses: dict[str, Array],
    worst_corner_px: Callable[..., float],
    averaged: Callable[..., Any],
    tmp_path: Path,
) -> None:
    vtk = pytest.importorskip("vtk", exc_type=ImportError)
    numpy_support = pytest.importorskip("vtk.util.numpy_support")
    target, T_cam_box = wrong_target if case == "built wrong" else make_target(), poses[view]
    path = tmp_path / "box.glb"
    path.write_bytes(box_glb(target))

    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(WIDTH * FINER, HEIGHT * FINER)
    window.AddRenderer(vtk.vtkRenderer())
    importer = vtk.vtkGLTFImporter()
    importer.SetFileName(str(path))
    importer.SetRenderWindow(window)
    importer.Update()
    renderer = window.GetRenderers().GetFirstRenderer()
    actors = renderer.GetActors()
    actors.InitTraversal()
    for _ in range(actors.GetNumberOfItems()):
        surface = actors.GetNextActor().GetProperty()
        surface.SetLighting(False)
        if texture := surface.GetTexture("albedoTex"):
            texture.SetMaximumAnisotropicFiltering(1)  # Mesa's shortcut for more moves edges by a fifth of a pixel
    R, t = T_cam_box[:3, :3], T_cam_box[:3, 3]
    eye = -R.T @ t
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*(BOX_GLTF.T @ eye))
    camera.SetFocalPoint(*(BOX_GLTF.T @ (eye + R[2])))
    camera.SetViewUp(*(BOX_GLTF.T @ -R[1]))
    camera.SetViewAngle(2 * np.degrees(np.arctan(HEIGHT / 2 / FOCAL_PX)))
    renderer.SetBackground(0.4, 0.4, 0.4)
    renderer.ResetCameraClippingRange()
    window.Render()
    grabber = vtk.vtkWindowToImageFilter()
    grabber.SetInput(window)
    grabber.ReadFrontBufferOff()
    grabber.Update()
    values = numpy_support.vtk_to_numpy(grabber.GetOutput().GetPointData().GetScalars())
    signal = values.reshape(HEIGHT * FINER, WIDTH * FINER, -1)[::-1, :, 0] / 255
    light = np.where(signal <= 0.04045, signal / 12.92, ((signal + 0.055) / 1.055) ** 2.4)

    assert worst_corner_px(averaged(255 * light, FINER), target, T_cam_box) < 0.1


def mujoco_scene(target: Target) -> Any:
    mujoco = pytest.importorskip("mujoco", exc_type=ImportError)
    files = box_mjcf(target)
    return mujoco.MjSpec.from_string(
        files["box.xml"].decode(), assets={name: data for name, data in files.items() if name != "box.xml"}
    )


@pytest.mark.parametrize(("case", "view"), VIEWS)
def test_mujoco_sees_the_box_as_our_renderer_does(  # noqa: PLR0917 - fixtures
    case: str,
    view: str,
    wrong_target: Target,
    poses: dict[str, Array],
    worst_corner_px: Callable[..., float],
    averaged: Callable[..., Any],
) -> None:
    mujoco = pytest.importorskip("mujoco", exc_type=ImportError)
    target, T_cam_box = wrong_target if case == "built wrong" else make_target(), poses[view]
    spec = mujoco_scene(target)
    visual = spec.visual.global_
    visual.offwidth, visual.offheight = WIDTH * FINER, HEIGHT * FINER
    spec.visual.quality.offsamples = 0
    R, t = T_cam_box[:3, :3], T_cam_box[:3, 3]
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.column_stack([R[0], -R[1], -R[2]]).ravel())
    camera = spec.worldbody.add_camera(name="camera", pos=-R.T @ t, quat=quat)
    camera.fovy = 2 * np.degrees(np.arctan(HEIGHT / 2 / FOCAL_PX))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, HEIGHT * FINER, WIDTH * FINER)
    except (ImportError, RuntimeError, AttributeError) as error:
        pytest.skip(f"MuJoCo has no off-screen renderer here ({os.environ['MUJOCO_GL']}: {error})")
    try:
        renderer.update_scene(data, camera="camera")
        light = renderer.render()[:, :, 0].astype(float)
    finally:
        renderer.close()

    assert worst_corner_px(averaged(light, FINER), target, T_cam_box) < 0.1


def test_mujoco_lets_things_rest_on_the_lid() -> None:
    mujoco = pytest.importorskip("mujoco", exc_type=ImportError)
    spec = mujoco_scene(make_target(SMALL))
    ball = spec.worldbody.add_body(name="ball", pos=[0, 0, SMALL.height + 0.05])
    ball.add_freejoint()
    ball.add_geom(size=[0.02, 0, 0], condim=6)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=2000)
    assert data.body("ball").xpos[2] == pytest.approx(SMALL.height + 0.02, abs=1e-3)


def test_gazebo_folder_holds_what_it_names() -> None:
    files = box_sdf(make_target(SMALL))
    config, model = (ET.fromstring(files[name]) for name in ("model.config", "model.sdf"))
    assert config.findtext("sdf") == "model.sdf"
    uri = model.findtext(".//visual/geometry/mesh/uri")
    assert uri is not None
    assert uri.startswith("model://landmark_box/")
    assert uri.removeprefix("model://landmark_box/") in files
    assert [float(x) for x in (model.findtext(".//collision/geometry/box/size") or "").split()] == pytest.approx(
        [SMALL.width, SMALL.depth, SMALL.height]
    )
    assert [float(x) for x in (model.findtext(".//collision/pose") or "").split()] == pytest.approx(
        [0, 0, SMALL.height / 2, 0, 0, 0]
    )
    material = files["meshes/box.mtl"].decode()
    for line in material.splitlines():
        if line.startswith("map_"):
            assert f"meshes/{line.split()[1]}" in files


def test_gltf_names_the_target_and_passes_a_strict_reader() -> None:
    pygltflib = pytest.importorskip("pygltflib")
    content = box_glb(make_target(SMALL))
    gltf = pygltflib.GLTF2.load_from_bytes(content)
    assert gltf.asset.version == "2.0"
    assert len(gltf.asset.extras["target"]) == 64
    assert len(gltf.images) == 4
    assert gltf.buffers[0].byteLength == len(gltf.binary_blob())
    for accessor in gltf.accessors:
        view = gltf.bufferViews[accessor.bufferView]
        size = {5126: 4, 5123: 2}[accessor.componentType] * {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor.type]
        assert view.byteOffset % 4 == 0
        assert size * accessor.count == view.byteLength
