"""The box as Wavefront OBJ with one texture a face, in frame ``box``, metres, z up."""

from collections.abc import Mapping

from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256
from boxcal.target.models.faces import encode_png
from boxcal.target.models.mesh import TRIANGLES, Side, sides

OBJ_NAME, MTL_NAME = "box.obj", "box.mtl"


def box_obj(target: Target) -> Mapping[str, bytes]:
    """Return ``box.obj``, its ``box.mtl`` and a PNG a face: file name -> content."""
    found = sides(target)
    files = {OBJ_NAME: _obj(found, target_sha256(target)), MTL_NAME: _mtl(found)}
    for side in found:
        if side.image is not None:
            files[f"{side.name}.png"] = encode_png(side.image.grey)
    return files


def _obj(found: tuple[Side, ...], digest: str) -> bytes:
    lines = [
        f"# Landmark box, target {digest[:12]}; metres, z up, origin at the centre of the base",
        f"mtllib {MTL_NAME}",
        "o landmark_box",
    ]
    for number, side in enumerate(found):
        first = 4 * number + 1
        lines += [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in side.corners + 0.0]
        lines += [f"vt {u:.9f} {1 - v:.9f}" for u, v in side.uv]
        lines.append("vn {:g} {:g} {:g}".format(*(side.normal + 0.0)))
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
