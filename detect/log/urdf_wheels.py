"""The wheels that a robot's URDF describes."""

import math
from collections.abc import Iterable
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import listed, printable
from boxcal.detect.log.wheel_names import Side, wheel_side
from boxcal.target.arrays import Array

_REMEDY = "give wheel_radius and wheel_separation in a YAML file instead"
_XACRO = "{http://www.ros.org/wiki/xacro}"
_SAME = 1e-6
_MAX_CHAIN = 1000


def urdf_wheels(content: bytes, name: str) -> tuple[float, float]:
    """Return (radius, separation), m, of a differential drive.

    The wheels are the continuous joints whose names say left or right wheel; a radius is that of the cylinder or sphere
    of the joint's child, separation is measured along the right wheel's axis with all joints at zero.

    Raises
    ------
    DetectError
        If it is no URDF, declares a document type (entities are not read), or does not describe two such wheels.
    """
    root = _parse(content, name)
    radius, T_right, T_left = _wheels(root, name)
    right = _wheel_joints(root, name)["right"]
    axis = _triple(_attribute(right, "axis", "xyz"), (1.0, 0.0, 0.0), name)
    if not np.linalg.norm(axis) > 0:
        raise DetectError("the right wheel's axis has no length", source=name, remedy=_REMEDY)
    axis = T_right[:3, :3] @ axis / np.linalg.norm(axis)
    return radius, float(abs(axis @ (T_left[:3, 3] - T_right[:3, 3])))


def urdf_camera(content: bytes, name: str, link: str | None = None) -> tuple[str, Array]:
    """Return the name of a camera's optical link, and its pose on the robot, (4, 4), m.

    The robot's frame is x forward as in the root link, its origin on the floor below the axle's middle. Without a link
    the only one counts whose name ends in ``optical_frame`` and does not speak of depth or infrared.

    Raises
    ------
    DetectError
        As :func:`urdf_wheels`, or if there is no such link.
    """
    root = _parse(content, name)
    radius, T_right, T_left = _wheels(root, name)
    by_child = {_link(j, "child"): j for j in root.findall("joint")}
    optical = [n for n in by_child if n.endswith("optical_frame") and not any(w in n for w in ("depth", "infra"))]
    chosen = [link] if link is not None else optical
    if len(chosen) != 1 or chosen[0] not in by_child:
        raise DetectError(
            f"no single camera link (asked for: {printable(link or 'optical_frame')}, found: {listed(optical)})",
            source=name,
            remedy="name the optical link of the camera",
        )
    T = _pose(by_child[chosen[0]], by_child, name)
    T[:3, 3] -= (T_right[:3, 3] + T_left[:3, 3]) / 2 - (0.0, 0.0, radius)
    return chosen[0], T


def _wheel_joints(root: ET.Element, name: str) -> dict[Side, ET.Element]:
    """Return the two driven wheels' joints."""
    joints = {j.get("name", ""): j for j in root.findall("joint")}
    wheels: dict[Side, ET.Element] = {}
    for side in ("left", "right"):
        found = [n for n, j in joints.items() if j.get("type") == "continuous" and wheel_side(n) == side]
        if len(found) != 1:
            turning = [n for n, j in joints.items() if j.get("type") == "continuous"]
            raise DetectError(
                f"{len(found)} {side} wheel joints (continuous joints: {listed(turning)}), one is needed",
                source=name,
                remedy=_REMEDY,
            )
        wheels[side] = joints[found[0]]
    return wheels


def _wheels(root: ET.Element, name: str) -> tuple[float, Array, Array]:
    """Return the wheels' radius, m, and the frames of the right and the left wheel's joint in the root link's."""
    by_child = {_link(j, "child"): j for j in root.findall("joint")}
    wheels = _wheel_joints(root, name)
    radii = [_radius(root, _link(wheels[side], "child"), name) for side in ("left", "right")]
    if abs(radii[0] - radii[1]) > _SAME:
        raise DetectError(
            f"wheels of radius {radii[0]:g} and {radii[1]:g} m, one nominal radius is needed",
            source=name,
            remedy=_REMEDY,
        )
    T_left, T_right = (_pose(wheels[side], by_child, name) for side in ("left", "right"))
    return radii[1], T_right, T_left


def _parse(content: bytes, name: str) -> ET.Element:
    def refuse(*_: object) -> None:
        raise DetectError("declares a document type, a plain URDF is needed", source=name, remedy=_REMEDY)

    scout = expat.ParserCreate()
    scout.StartDoctypeDeclHandler = refuse
    try:
        scout.Parse(content, True)
        root = ET.fromstring(content)  # noqa: S314  (no document type, so no entities: checked above)
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as error:
        raise DetectError(f"not a whole URDF ({error})", source=name, remedy=_REMEDY) from error
    if any(str(element.tag).startswith(_XACRO) for element in root.iter()):
        raise DetectError(
            "holds xacro macros, a plain URDF is needed", source=name, remedy="expand it with xacro first"
        )
    if root.tag != "robot":
        raise DetectError(f"its root is {printable(root.tag)}, robot is needed", source=name, remedy=_REMEDY)
    return root


def _radius(root: ET.Element, link: str, name: str) -> float:
    for element in root.findall("link"):
        if element.get("name") == link:
            for kind in ("collision", "visual"):
                for shape in ("cylinder", "sphere"):
                    found = element.find(f"{kind}/geometry/{shape}")
                    if found is not None:
                        return _number(found.get("radius", ""), name)
    raise DetectError(
        f"link {printable(link)} has no cylinder or sphere, a wheel's radius is needed",
        source=name,
        remedy=_REMEDY,
    )


def _pose(joint: ET.Element, by_child: dict[str, ET.Element], name: str) -> Array:
    """Return a joint's frame in that of the root link, (4, 4), all joints at zero."""
    T = _origin(joint, name)
    for _ in range(_MAX_CHAIN):
        above = by_child.get(_link(joint, "parent"))
        if above is None:
            return T
        joint = above
        T = _origin(joint, name) @ T
    raise DetectError("its joints form a ring, a tree is needed", source=name, remedy=_REMEDY)


def _origin(joint: ET.Element, name: str) -> Array:
    zero = (0.0, 0.0, 0.0)
    xyz = _triple(_attribute(joint, "origin", "xyz"), zero, name)
    rpy = _triple(_attribute(joint, "origin", "rpy"), zero, name)
    T = np.eye(4)
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - .2 s to import, and few logs hold a URDF

    T[:3, :3], T[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
    return T


def _attribute(joint: ET.Element, tag: str, attribute: str) -> str | None:
    element = joint.find(tag)
    return None if element is None else element.get(attribute)


def _link(joint: ET.Element, end: str) -> str:
    return _attribute(joint, end, "link") or ""


def _triple(text: str | None, default: Iterable[float], name: str) -> Array:
    values = list(default) if text is None else [_number(word, name) for word in text.split()[:4]]
    if len(values) != 3:
        raise DetectError(f"{printable(text or '')!r} are not three numbers", source=name, remedy=_REMEDY)
    return np.array(values)


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        hint = "expand it with xacro first" if "$" in text else _REMEDY
        raise DetectError(f"{printable(text)!r} is no number", source=name, remedy=hint)
    return value
