"""Products of ``make-target`` besides the paper: images, simulator models, CAD and cut files.

Light to import: every product brings in what it needs when it is made.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from boxcal.target.box import Target

EXTRAS: Mapping[str, tuple[str, ...]] = {"cad": ("cadquery", "ezdxf", "manifold3d")}
"""The modules that an extra of the package brings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """One file or folder that can be made of a target.

    Attributes
    ----------
    name
        Of the file or folder, relative to where the target is written.
    extra
        The extra of the package that it needs; empty if none.
    what
        One line about it.
    make
        Returns relative path -> content; all paths are ``name`` or lie in it. Raises TargetError.
    """

    name: str
    extra: str
    what: str
    make: "Callable[[Target], Mapping[str, bytes]]"


def products(*, dpi: float = 300.0) -> tuple[Product, ...]:
    """Return all products, ``dpi`` being the resolution of the faces' images."""
    return (
        Product(
            name="faces",
            extra="",
            what=f"the four faces as PNG pictures at {dpi:g} dpi",
            make=lambda target: _faces(target, dpi),
        ),
        Product(name="box.glb", extra="", what="textured model, binary glTF (Blender, Isaac Sim, web)", make=_glb),
        Product(name="obj", extra="", what="textured model, Wavefront OBJ with a picture a face, y up", make=_obj),
        Product(name="landmark_box", extra="", what="model folder for Gazebo (SDF)", make=_sdf),
        Product(name="mujoco", extra="", what="model for MuJoCo (MJCF)", make=_mjcf),
        Product(name="svg", extra="", what="faces and fold-up net as drawings in mm (SVG)", make=_svg),
        Product(name="kalibr", extra="", what="the faces as grids in the manner of Kalibr (YAML)", make=_kalibr),
        Product(
            name="localisation",
            extra="",
            what="the box as a landmark for OpenCV (ArUco board) and apriltag_ros (tags.yaml)",
            make=_localisation,
        ),
        Product(name="pictures", extra="", what="pictures of the assembled box", make=_pictures),
        Product(name="cad", extra="cad", what="body, lid, pin and jointed panels: STEP, and STL to print", make=_cad),
        Product(name="cut", extra="cad", what="panels and fold-up net for a laser cutter or plotter (DXF)", make=_cut),
        Product(name="print", extra="cad", what="two-colour prints with the tags inlaid (3MF)", make=_print),
    )


def missing_modules(product: Product) -> tuple[str, ...]:
    """Return the modules of the product's extra that are not installed; looks for them without importing them."""
    return tuple(name for name in EXTRAS.get(product.extra, ()) if find_spec(name) is None)


def _faces(target: "Target", dpi: float) -> Mapping[str, bytes]:
    from boxcal.target.models.faces import face_pngs  # noqa: PLC0415 - heavy

    return _within("faces", face_pngs(target, dpi=dpi))


def _glb(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.models.glb import box_glb  # noqa: PLC0415 - heavy

    return {"box.glb": box_glb(target)}


def _obj(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.models.obj import box_obj  # noqa: PLC0415 - heavy

    return _within("obj", box_obj(target))


def _sdf(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.models.sdf import box_sdf  # noqa: PLC0415 - heavy

    return _within("landmark_box", box_sdf(target))


def _mjcf(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.models.mjcf import box_mjcf  # noqa: PLC0415 - heavy

    return _within("mujoco", box_mjcf(target))


def _kalibr(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.models.kalibr import face_grids  # noqa: PLC0415 - heavy

    return _within("kalibr", face_grids(target))


def _svg(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.print.svg import svg_files  # noqa: PLC0415 - heavy

    return _within("svg", svg_files(target))


def _localisation(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.models.localisation import apriltag_ros_files, opencv_board  # noqa: PLC0415 - heavy

    return _within("localisation", {"opencv-board.yml": opencv_board(target), **apriltag_ros_files(target)})


def _pictures(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.render.pictures import box_pictures  # noqa: PLC0415 - heavy

    return _within("pictures", box_pictures(target))


def _cad(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.cad.solid import box_step, box_stls, panels_step  # noqa: PLC0415 - heavy

    steps = {"box.step": box_step(target), "panels.step": panels_step(target)}
    return _within("cad", steps | box_stls(target))


def _cut(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.cad.cut import net_dxf, panels_dxf  # noqa: PLC0415 - heavy

    return _within("cut", {"panels.dxf": panels_dxf(target), "net.dxf": net_dxf(target)})


def _print(target: "Target") -> Mapping[str, bytes]:
    from boxcal.target.cad.inlay import prints  # noqa: PLC0415 - heavy

    return _within("print", prints(target))


def _within(folder: str, files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    return {f"{folder}/{name}": content for name, content in files.items()}
