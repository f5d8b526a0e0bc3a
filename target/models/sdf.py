"""The box as a model folder for Gazebo: SDF with the textured mesh to see and a plain box to touch."""

from collections.abc import Mapping
from xml.etree import ElementTree as ET

from boxcal.target.box import Target
from boxcal.target.files.target_json import target_sha256
from boxcal.target.models.obj import OBJ_NAME, box_obj

SDF_NAME = "landmark_box"
_SDF_VERSION = "1.7"


def box_sdf(target: Target) -> Mapping[str, bytes]:
    """Return a Gazebo model folder's files, path within it -> content.

    The model stands still; its frame is ``box``. Put the folder on Gazebo's resource path and include
    ``model://landmark_box``.
    """
    files = {"model.config": _config(target_sha256(target)), "model.sdf": _sdf(target)}
    return files | {f"meshes/{name}": content for name, content in box_obj(target, y_up=False).items()}


def _sdf(target: Target) -> bytes:
    box = target.box
    root = ET.Element("sdf", version=_SDF_VERSION)
    model = ET.SubElement(root, "model", name=SDF_NAME)
    ET.SubElement(model, "static").text = "true"
    link = ET.SubElement(model, "link", name="box")
    visual = ET.SubElement(link, "visual", name="faces")
    ET.SubElement(
        ET.SubElement(ET.SubElement(visual, "geometry"), "mesh"), "uri"
    ).text = f"model://{SDF_NAME}/meshes/{OBJ_NAME}"
    collision = ET.SubElement(link, "collision", name="outline")
    ET.SubElement(collision, "pose").text = f"0 0 {box.height / 2:.9g} 0 0 0"
    size = ET.SubElement(ET.SubElement(ET.SubElement(collision, "geometry"), "box"), "size")
    size.text = f"{box.width:.9g} {box.depth:.9g} {box.height:.9g}"
    return _document(root)


def _config(digest: str) -> bytes:
    root = ET.Element("model")
    ET.SubElement(root, "name").text = "Landmark box"
    ET.SubElement(root, "version").text = "1.0"
    ET.SubElement(root, "sdf", version=_SDF_VERSION).text = "model.sdf"
    ET.SubElement(root, "description").text = f"Calibration box with tags, target {digest[:12]}"
    return _document(root)


def _document(root: ET.Element) -> bytes:
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"
