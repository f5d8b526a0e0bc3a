"""JSON schemas of the Foxglove messages that results are written as."""

from typing import Any

Schema = dict[str, Any]

_NUMBER, _TEXT, _FLAG = ({"type": kind} for kind in ("number", "string", "boolean"))
_COUNT = {"type": "integer", "minimum": 0}
_NSEC = {**_COUNT, "maximum": 999_999_999}


def _object(title: str, **properties: Schema) -> Schema:
    return {"title": title, "type": "object", "properties": properties, "required": list(properties)}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _numbers(count: int | None = None) -> Schema:
    return {**_list(_NUMBER), **({} if count is None else {"minItems": count, "maxItems": count})}


def _one_of(title: str, **values: int) -> Schema:
    return {"title": title, "oneOf": [{"title": name, "const": value} for name, value in values.items()]}


def _foxglove(name: str, **properties: Schema) -> Schema:
    return _object(f"foxglove.{name}", **properties)


_TIME = _object("time", sec=_COUNT, nsec=_NSEC)
_DURATION = _object("duration", sec={"type": "integer"}, nsec=_NSEC)
_POINT2 = _foxglove("Point2", x=_NUMBER, y=_NUMBER)
_POINT3 = _foxglove("Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_VECTOR3 = _foxglove("Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _foxglove("Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _foxglove("Pose", position=_VECTOR3, orientation=_QUATERNION)
_COLOUR = _foxglove("Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_PAIR = _foxglove("KeyValuePair", key=_TEXT, value=_TEXT)
_CUBE = _foxglove("CubePrimitive", pose=_POSE, size=_VECTOR3, color=_COLOUR)
_ARROW = _foxglove(
    "ArrowPrimitive",
    pose=_POSE,
    shaft_length=_NUMBER,
    shaft_diameter=_NUMBER,
    head_length=_NUMBER,
    head_diameter=_NUMBER,
    color=_COLOUR,
)
_LINE = _foxglove(
    "LinePrimitive",
    type=_one_of("foxglove.LineType", LINE_STRIP=0, LINE_LOOP=1, LINE_LIST=2),
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_FLAG,
    points=_list(_POINT3),
    color=_COLOUR,
    colors=_list(_COLOUR),
    indices=_list(_COUNT),
)
_WORDS = _foxglove(
    "TextPrimitive",
    pose=_POSE,
    billboard=_FLAG,
    font_size=_NUMBER,
    scale_invariant=_FLAG,
    color=_COLOUR,
    text=_TEXT,
)
_NONE = {**_list({"type": "object"}), "maxItems": 0}
_ENTITY = _foxglove(
    "SceneEntity",
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked=_FLAG,
    metadata=_list(_PAIR),
    arrows=_list(_ARROW),
    cubes=_list(_CUBE),
    spheres=_NONE,
    cylinders=_NONE,
    lines=_list(_LINE),
    triangles=_NONE,
    texts=_list(_WORDS),
    models=_NONE,
)
_DELETION = _foxglove(
    "SceneEntityDeletion",
    timestamp=_TIME,
    type=_one_of("foxglove.SceneEntityDeletionType", MATCHING_ID=0, ALL=1),
    id=_TEXT,
)
_POINTS = _foxglove(
    "PointsAnnotation",
    timestamp=_TIME,
    type=_one_of("foxglove.PointsAnnotationType", UNKNOWN=0, POINTS=1, LINE_LOOP=2, LINE_STRIP=3, LINE_LIST=4),
    points=_list(_POINT2),
    outline_color=_COLOUR,
    outline_colors=_list(_COLOUR),
    fill_color=_COLOUR,
    thickness=_NUMBER,
    metadata=_list(_PAIR),
)
_TEXT_ANNOTATION = _foxglove(
    "TextAnnotation",
    timestamp=_TIME,
    position=_POINT2,
    text=_TEXT,
    font_size=_NUMBER,
    text_color=_COLOUR,
    background_color=_COLOUR,
    metadata=_list(_PAIR),
)

SCHEMAS: dict[str, Schema] = {
    "foxglove.FrameTransform": _foxglove(
        "FrameTransform",
        timestamp=_TIME,
        parent_frame_id=_TEXT,
        child_frame_id=_TEXT,
        translation=_VECTOR3,
        rotation=_QUATERNION,
    ),
    "foxglove.SceneUpdate": _foxglove("SceneUpdate", deletions=_list(_DELETION), entities=_list(_ENTITY)),
    "foxglove.ImageAnnotations": _foxglove(
        "ImageAnnotations", circles=_NONE, points=_list(_POINTS), texts=_list(_TEXT_ANNOTATION)
    ),
    "foxglove.CompressedImage": _foxglove(
        "CompressedImage",
        timestamp=_TIME,
        frame_id=_TEXT,
        data={**_TEXT, "contentEncoding": "base64"},
        format=_TEXT,
    ),
    "foxglove.CameraCalibration": _foxglove(
        "CameraCalibration",
        timestamp=_TIME,
        frame_id=_TEXT,
        width=_COUNT,
        height=_COUNT,
        distortion_model=_TEXT,
        D=_numbers(),
        K=_numbers(9),
        R=_numbers(9),
        P=_numbers(12),
    ),
}
"""By the name that Foxglove knows each by."""
