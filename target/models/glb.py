"""The box as binary glTF 2.0 with its textures inside (Khronos glTF 2.0 specification)."""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256
from boxcal.target.models.faces import encode_png
from boxcal.target.models.mesh import TRIANGLES, sides

_FLOAT, _USHORT = 5126, 5123
_VERTICES, _INDICES = 34962, 34963
_LINEAR, _MIPMAPPED, _CLAMP = 9729, 9987, 33071
_Z_UP_TO_Y_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]


def box_glb(target: Target) -> bytes:
    """Return the box as one GLB file, metres.

    glTF has y up: the root node ``landmark_box`` turns frame ``box`` (z up) by -90 deg about x, and below it, in node
    ``box``, all dimensions are in frame ``box``.
    """
    blob = _Blob()
    materials: list[dict[str, Any]] = [_matt("plain")]
    textures: list[dict[str, Any]] = []
    images: list[dict[str, Any]] = []
    primitives = []
    for side in sides(target):
        material = 0
        if side.image is not None:
            images.append(
                {"name": side.name, "mimeType": "image/png", "bufferView": blob.view(encode_png(side.image.grey))}
            )
            textures.append({"sampler": 0, "source": len(images) - 1})
            material = len(materials)
            materials.append(_matt(side.name, texture=len(textures) - 1))
        attributes = {
            "POSITION": blob.vectors(side.corners, "VEC3", bounds=True),
            "NORMAL": blob.vectors(np.tile(side.normal, (4, 1)), "VEC3"),
            "TEXCOORD_0": blob.vectors(side.uv, "VEC2"),
        }
        primitives.append({"attributes": attributes, "indices": blob.indices(), "material": material})
    document = {
        "asset": {"version": "2.0", "generator": "make-target", "extras": {"target": target_sha256(target)}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "landmark_box", "rotation": _Z_UP_TO_Y_UP, "children": [1]},
            {"name": "box", "mesh": 0},
        ],
        "meshes": [{"name": "box", "primitives": primitives}],
        "materials": materials,
        "samplers": [{"magFilter": _LINEAR, "minFilter": _MIPMAPPED, "wrapS": _CLAMP, "wrapT": _CLAMP}],
        "accessors": blob.accessors,
        "bufferViews": blob.views,
    }
    if images:
        document |= {"images": images, "textures": textures}
    document["buffers"] = [{"byteLength": len(blob.data)}]
    return _container(json.dumps(document, separators=(",", ":")).encode(), bytes(blob.data))


def _matt(name: str, *, texture: int | None = None) -> dict[str, Any]:
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    if texture is not None:
        surface["baseColorTexture"] = {"index": texture}
    return {"name": name, "pbrMetallicRoughness": surface}


class _Blob:
    """The binary part of a glTF file as it grows, with the views and accessors into it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, content: bytes, purpose: int | None = None) -> int:
        """Add bytes and return their view's index; each begins at a multiple of four bytes."""
        entry: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        if purpose is not None:
            entry["target"] = purpose
        self.data += content + bytes(-len(content) % 4)
        self.views.append(entry)
        return len(self.views) - 1

    def vectors(self, values: NDArray[np.float64], kind: str, *, bounds: bool = False) -> int:
        """Add vectors (N, n) as 32 bit floats and return their accessor's index."""
        floats = values.astype("<f4")
        entry: dict[str, Any] = {
            "bufferView": self.view(floats.tobytes(), _VERTICES),
            "componentType": _FLOAT,
            "count": len(floats),
            "type": kind,
        }
        if bounds:
            entry |= {"min": floats.min(axis=0).tolist(), "max": floats.max(axis=0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def indices(self) -> int:
        """Add a side's two triangles and return their accessor's index."""
        corners = np.array(TRIANGLES, dtype="<u2").ravel()
        view = self.view(corners.tobytes(), _INDICES)
        self.accessors.append({"bufferView": view, "componentType": _USHORT, "count": len(corners), "type": "SCALAR"})
        return len(self.accessors) - 1


def _container(document: bytes, data: bytes) -> bytes:
    document += b" " * (-len(document) % 4)
    parts = struct.pack("<I4s", len(document), b"JSON") + document + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(parts)) + parts
