"""The box as Wavefront OBJ with one texture a face, metres.

Programs that draw take an OBJ's y as up (Blender, MeshLab, three.js); simulators of robots take its axes as they are.
"""

from collections.abc import Mapping

import numpy as np

from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256
from boxcal.target.models.faces import encode_png
from boxcal.target.models.mesh import TRIANGLES, Side, sides

OBJ_NAME, MTL_NAME = "box.obj", "box.mtl"
_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Maps frame ``box`` to axes with y up."""


def box_obj(target: Target, *, y_up: bool = True) -> Mapping[str, bytes]:
    """Return ``box.obj``, its ``box.mtl`` and a PNG a face: file name -> content.

    Parameters
    ----------
    target
        The box.
    y_up
        Whether frame ``box``'s (x, y, z) are written as (x, z, -y), so that the box stands upright where y is up;
        otherwise z is up.
    """
    found = sides(target)
    files = {OBJ_NAME: _obj(found, target_sha256(target), y_up=y_up), MTL_NAME: _mtl(found)}
    for side in found:
        if side.image is not None:
            files[f"{side.name}.png"] = encode_png(side.image.grey)
    return files


def _obj(found: tuple[Side, ...], digest: str, *, y_up: bool) -> bytes:
    axes = _Y_UP if y_up else np.eye(3)
    lines = [
        f"# Landmark box, target {digest[:12]}; metres, {'y' if y_up else 'z'} up, origin at the centre of the base",
        f"mtllib {MTL_NAME}",
        "o landmark_box",
    ]
    for number, side in enumerate(found):
        first = 4 * number + 1
        lines += [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in side.corners @ axes.T + 0.0]
        lines += [f"vt {u:.9f} {1 - v:.9f}" for u, v in side.uv]
        lines.append("vn {:g} {:g} {:g}".format(*(axes @ side.normal + 0.0)))
        lines += [f"g {side.name}", f"usemtl {side.name if side.image is not None else 'plain'}"]
        lines += ["f " + " ".join(f"{first + k}/{first + k}/{number + 1}" for k in triangle) for triangle in TRIANGLES]
    return ("\n".join(lines) + "\n").encode()


def _mtl(found: tuple[Side, ...]) -> bytes:
    matt = ["Ka 1 1 1", "Kd 1 1 1", "Ks 0 0 0", "d 1", "illum 1"]
    lines = ["newmtl plain", *matt]
    for side in found:
        if side.image is not None:
            lines += ["", f"newmtl {side.name}", *matt, f"map_Ka {side.name}.png", f"map_Kd {side.name}.png"]
    return ("\n".join(lines) + "\n").encode()
