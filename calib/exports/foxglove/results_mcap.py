"""``--results-mcap``: what happened on a robot's drives, as Foxglove messages on the log's time line."""

import io
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from boxcal.calib.exports.foxglove import messages as fox
from boxcal.calib.exports.foxglove.schemas import SCHEMAS
from boxcal.calib.exports.lens_models import ros_distortion
from boxcal.calib.exports.names import BODY, OPTICAL
from boxcal.calib.exports.scene import MAGNIFIED, Images, Scene, residual_colours
from boxcal.calib.geometry.so3_se3 import inverse, planar, rigid
from boxcal.calib.results.stop_residuals import SeenStop
from boxcal.target.arrays import Array

BOX = "box"
_GREY, _RED, _BLUE, _WHITE = (0.7, 0.7, 0.7), (1.0, 0.1, 0.1), (0.2, 0.5, 1.0), (1.0, 1.0, 1.0)
_KINDS = {
    "/tf": "foxglove.FrameTransform",
    "/scene": "foxglove.SceneUpdate",
    "/camera/image": "foxglove.CompressedImage",
    "/camera/annotations": "foxglove.ImageAnnotations",
    "/camera/calibration": "foxglove.CameraCalibration",
}

Item = tuple[int, str, fox.Message]
"""Time (ns), topic, message."""


def results_mcap(scene: Scene, images: Images) -> bytes:
    """Return an MCAP file.

    Parameters
    ----------
    scene
        What happened.
    images
        Time (ns) and JPEG of a frame of each stop, as :func:`boxcal.calib.exports.stop_images.stop_jpegs` gives them.
    """
    items = [*_still(scene), *_poses(scene)]
    for stop in scene.stops:
        items.extend(_seen(stop, *images.get((stop.drive, stop.number), (stop.view.t_start_ns, b""))))
    out = io.BytesIO()
    writer: Any = Writer(out, compression=CompressionType.ZSTD)
    writer.start(library="boxcal")
    channels = {}
    for topic, kind in _KINDS.items():
        schema = writer.register_schema(kind, "jsonschema", json.dumps(SCHEMAS[kind]).encode())
        channels[topic] = writer.register_channel(topic, "json", schema)
    for t_ns, topic, message in sorted(items, key=lambda item: item[0]):
        data = json.dumps(message, allow_nan=False, separators=(",", ":")).encode()
        writer.add_message(channels[topic], log_time=t_ns, publish_time=t_ns, data=data)
    writer.finish()
    return out.getvalue()


def _still(scene: Scene) -> Iterator[Item]:
    """Yield what does not change: the camera, its extrinsics, the box, the whole path."""
    c, box = scene.calibration, scene.target.box
    t = scene.stops[0].view.t_start_ns if scene.stops else 0
    k, lens = c.camera, ros_distortion(c)
    model = "kannala_brandt" if lens.model == "equidistant" else lens.model
    yield (
        t,
        "/camera/calibration",
        {
            "timestamp": fox.stamp(t),
            "frame_id": OPTICAL,
            "width": c.image_size[0],
            "height": c.image_size[1],
            "distortion_model": model,
            "D": list(lens.coefficients),
            "K": k.K.ravel().tolist(),
            "R": np.eye(3).ravel().tolist(),
            "P": np.column_stack([k.K, np.zeros(3)]).ravel().tolist(),
        },
    )
    yield t, "/tf", fox.frame_transform(t, BODY, OPTICAL, c.T_body_cam)
    middle = rigid(np.eye(3), np.array([0.0, 0.0, box.height / 2]))
    size = fox.vector((box.width, box.depth, box.height))
    cube = {"pose": fox.pose(middle), "size": size, "color": fox.colour(_WHITE, 0.5)}
    corners = scene.target.tag_corners
    outlines = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 3)
    paths = [
        fox.lines(np.column_stack([p.poses[:, :2], np.zeros(len(p.poses))]), _GREY if p.used else _RED, fox.STRIP)
        for p in scene.path
    ]
    bodies = [(s.label, s.result.T_box_cam @ inverse(c.T_body_cam)) for s in scene.stops]
    arrows = [
        {
            "pose": fox.pose(T),
            "shaft_length": 0.06,
            "shaft_diameter": 0.01,
            "head_length": 0.03,
            "head_diameter": 0.02,
            "color": fox.colour(_BLUE),
        }
        for _, T in bodies
    ]
    names = [fox.text(T[:3, 3] + (0.0, 0.0, 0.02), f"stop {label}") for label, T in bodies]
    entities = [
        fox.entity(t, BOX, "box", cubes=[cube], lines=[fox.lines(outlines, (0, 0, 0), fox.LIST, 1.0)]),
        fox.entity(t, BOX, "path", lines=paths),
        fox.entity(t, BOX, "stops", arrows=arrows, texts=names),
    ]
    yield t, "/scene", {"deletions": [], "entities": entities}


def _poses(scene: Scene) -> Iterator[Item]:
    """Yield where the robot is: at stops by the images, between them by the wheels."""
    for stop in scene.stops:
        T = stop.result.T_box_cam @ inverse(scene.calibration.T_body_cam)
        for t in sorted({stop.view.t_start_ns, stop.view.t_end_ns}):
            yield t, "/tf", fox.frame_transform(t, BOX, BODY, T)
    for path in scene.path:
        for t, at in zip(path.t_ns[1:-1].tolist(), path.poses[1:-1], strict=True):
            yield t, "/tf", fox.frame_transform(t, BOX, BODY, planar(*at))


def _seen(stop: SeenStop, t: int, jpeg: bytes) -> Iterator[Item]:
    """Yield a stop's image with its corners: points where they were seen, lines from where they were expected."""
    if jpeg:
        yield t, "/camera/image", fox.compressed_image(t, OPTICAL, jpeg)
    ahead = np.all(np.isfinite(stop.error_px), axis=1)
    uv, error = stop.view.uv_px[ahead], stop.error_px[ahead]
    colours = residual_colours(error, stop.used[ahead])
    points = [
        fox.points_annotation(t, fox.POINTS, uv, colours, 4.0),
        fox.points_annotation(t, fox.LINE_LIST, _lines_of(uv, error), colours, 1.0),
    ]
    words = f"stop {stop.label}: {stop.result.reprojection_rms_px:.3f} px rms, lines x {MAGNIFIED:g}"
    texts = [fox.text_annotation(t, (4.0, 18.0), words)]
    yield t, "/camera/annotations", {"circles": [], "points": points, "texts": texts}


def _lines_of(uv_px: Array, error_px: Array) -> Array:
    """Return ends of lines (2 N, 2), from where a corner was expected to it, magnified."""
    expected = uv_px - error_px
    return np.stack([expected, expected + MAGNIFIED * error_px], axis=1).reshape(-1, 2)
