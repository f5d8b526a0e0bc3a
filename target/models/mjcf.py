"""The box for MuJoCo: an MJCF model with one mesh and one texture that holds all four faces."""

from collections.abc import Mapping
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array
from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256
from boxcal.target.models.faces import encode_png
from boxcal.target.models.mesh import TRIANGLES, Side, sides

MJCF_NAME, ATLAS_NAME = "box.xml", "box-faces.png"


def box_mjcf(target: Target) -> Mapping[str, bytes]:
    """Return ``box.xml`` and its texture: file name -> content.

    The model's frame is ``box``: the body ``landmark_box`` stands at the world's origin. What is seen is a mesh; what
    is touched is a plain box. The light in the file comes from the camera and is even; include the file, or attach
    its body, to place the box elsewhere.
    """
    found = sides(target)
    atlas, uv = _atlas(found)
    return {MJCF_NAME: _xml(target, found, uv), ATLAS_NAME: encode_png(atlas)}


def _atlas(found: tuple[Side, ...]) -> tuple[NDArray[np.uint8], Array]:
    """Return the sides' images below each other and the corners' places in it (S, 4, 2), right and down."""
    images = [side.image.grey for side in found if side.image is not None] or [np.full((8, 8), 255, dtype=np.uint8)]
    width, height = max(g.shape[1] for g in images), sum(g.shape[0] for g in images)
    atlas = np.full((height, width), 255, dtype=np.uint8)
    white = np.full((4, 2), 1 / (2 * height))
    places, row = [], 0
    for side in found:
        if side.image is None:
            places.append(white)
            continue
        h, w = side.image.grey.shape
        atlas[row : row + h, :w] = side.image.grey
        places.append((side.uv * (w, h) + (0, row)) / (width, height))
        row += h
    return atlas, np.stack(places)


def _xml(target: Target, found: tuple[Side, ...], uv: Array) -> bytes:
    box = target.box
    root = ET.Element("mujoco", model="landmark_box")
    root.append(ET.Comment(f" target {target_sha256(target)[:12]}; metres, z up, origin at the centre of the base "))
    ET.SubElement(ET.SubElement(root, "visual"), "headlight", ambient="0.9 0.9 0.9", diffuse="0 0 0", specular="0 0 0")
    asset = ET.SubElement(root, "asset")
    ET.SubElement(asset, "texture", name="faces", type="2d", file=ATLAS_NAME)
    ET.SubElement(asset, "material", name="faces", texture="faces", specular="0", shininess="0", reflectance="0")
    triangles = np.concatenate([4 * k + np.array(TRIANGLES) for k in range(len(found))])
    ET.SubElement(
        asset,
        "mesh",
        name="faces",
        vertex=_numbers(np.concatenate([side.corners for side in found])),
        normal=_numbers(np.concatenate([np.tile(side.normal, (4, 1)) for side in found])),
        texcoord=_numbers(uv),
        face=" ".join(str(k) for k in triangles.ravel()),
    )
    body = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name="landmark_box")
    # Group 0 is drawn by default, group 3 is not.
    ET.SubElement(
        body,
        "geom",
        name="faces",
        type="mesh",
        mesh="faces",
        material="faces",
        contype="0",
        conaffinity="0",
        mass="0",
        group="0",
    )
    half = np.array([box.width, box.depth, box.height]) / 2
    ET.SubElement(
        body, "geom", name="outline", type="box", size=_numbers(half), pos=_numbers(half * (0, 0, 1)), group="3"
    )
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.9g}" for v in np.ravel(values) + 0.0)
