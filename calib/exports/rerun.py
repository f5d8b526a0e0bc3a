"""``--rerun``: what happened on a robot's drives, for the Rerun viewer, on the log's time line (extra ``rerun``)."""

import secrets
from importlib import import_module
from typing import Any

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.scene import MAGNIFIED, Images, Scene, residual_colours
from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.results.stop_residuals import SeenStop
from boxcal.target.arrays import Array

_TIMELINE = "log"
_PIXEL_CORNER = 0.5
_GREY, _RED, _BLUE = (178, 178, 178), (255, 26, 26), (51, 128, 255)
_BODY, _CAMERA = "box/body", "box/body/camera"


def rerun_recording(scene: Scene, images: Images) -> bytes:
    """Return a recording for the Rerun viewer (``.rrd``).

    Rerun's pinhole knows no distortion: corners fit the image, the box in 3-D fits it only as far as the lens is plain.

    Parameters
    ----------
    scene
        What happened.
    images
        Time (ns) and JPEG of a frame of each stop, as :func:`boxcal.calib.exports.stop_images.stop_jpegs` gives them.

    Raises
    ------
    CalibError
        If Rerun is not installed.
    """
    try:
        rr = import_module("rerun")
    except ImportError as error:
        raise CalibError(
            "the rerun package is not installed", remedy="pip install 'boxcal[rerun]' or leave out --rerun"
        ) from error
    stream = rr.RecordingStream("boxcal", recording_id=f"boxcal-{secrets.token_hex(8)}")
    memory = stream.memory_recording()
    _still(rr, stream, scene)
    _poses(rr, stream, scene)
    for stop in scene.stops:
        _seen(rr, stream, stop, images.get((stop.drive, stop.number)))
    return bytes(memory.drain_as_bytes())


def _still(rr: Any, stream: Any, scene: Scene) -> None:
    """Log what does not change: the box, the camera and its extrinsics, the whole path."""
    c, box = scene.calibration, scene.target.box
    stream.log("box", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    half = (box.width / 2, box.depth / 2, box.height / 2)
    stream.log("box/solid", rr.Boxes3D(centers=[(0.0, 0.0, half[2])], half_sizes=[half]), static=True)
    corners = scene.target.tag_corners
    stream.log(
        "box/tags", rr.LineStrips3D(np.concatenate([corners, corners[:, :1]], axis=1), radii=0.0005), static=True
    )
    paths = [np.column_stack([p.poses[:, :2], np.zeros(len(p.poses))]) for p in scene.path]
    shades = [_GREY if p.used else _RED for p in scene.path]
    stream.log("box/path", rr.LineStrips3D(paths, colors=shades, radii=0.002), static=True)
    bodies = np.array([_body(stop, c.T_body_cam) for stop in scene.stops]).reshape(-1, 4, 4)
    names = [f"stop {stop.label}" for stop in scene.stops]
    stream.log(
        "box/stops",
        rr.Arrows3D(origins=bodies[:, :3, 3], vectors=0.09 * bodies[:, :3, 0], labels=names, colors=[_BLUE]),
        static=True,
    )
    stream.log(_CAMERA, _transform(rr, c.T_body_cam), static=True)
    K = c.camera.K
    K[:2, 2] += _PIXEL_CORNER
    pinhole = rr.Pinhole(image_from_camera=K, resolution=list(c.image_size), camera_xyz=rr.ViewCoordinates.RDF)
    stream.log(f"{_CAMERA}/image", pinhole, static=True)


def _poses(rr: Any, stream: Any, scene: Scene) -> None:
    """Log where the robot is: at stops by the images, between them by the wheels."""
    items = [
        (t, _body(stop, scene.calibration.T_body_cam))
        for stop in scene.stops
        for t in sorted({stop.view.t_start_ns, stop.view.t_end_ns})
    ]
    for path in scene.path:
        items += [(t, planar(*at)) for t, at in zip(path.t_ns[1:-1].tolist(), path.poses[1:-1], strict=True)]
    for t, T in sorted(items, key=lambda item: item[0]):
        _at(stream, t)
        stream.log(_BODY, _transform(rr, T))


def _seen(rr: Any, stream: Any, stop: SeenStop, image: tuple[int, bytes] | None) -> None:
    """Log a stop's image with its corners: points where they were seen, lines from where they were expected."""
    t = stop.view.t_start_ns if image is None else image[0]
    _at(stream, t)
    if image is not None:
        stream.log(f"{_CAMERA}/image/picture", rr.EncodedImage(contents=image[1], media_type="image/jpeg"))
    ahead = np.all(np.isfinite(stop.error_px), axis=1)
    uv, error = stop.view.uv_px[ahead] + _PIXEL_CORNER, stop.error_px[ahead]
    shades = np.round(255 * residual_colours(error, stop.used[ahead])).astype(np.uint8)
    ids = [f"landmark {i}" for i in stop.view.landmark_ids[ahead].tolist()]
    stream.log(f"{_CAMERA}/image/corners", rr.Points2D(uv, colors=shades, radii=1.5, labels=ids, show_labels=False))
    ends = np.stack([uv - error, uv + (MAGNIFIED - 1) * error], axis=1)
    stream.log(f"{_CAMERA}/image/residuals", rr.LineStrips2D(ends, colors=shades, radii=0.5))
    stream.log("residual_px", rr.Scalars(stop.result.reprojection_rms_px))


def _at(stream: Any, t_ns: int) -> None:
    stream.set_time(_TIMELINE, timestamp=np.datetime64(t_ns, "ns"))


def _body(stop: SeenStop, T_body_cam: Array) -> Array:
    return np.asarray(stop.result.T_box_cam @ inverse(T_body_cam))


def _transform(rr: Any, T: Array) -> Any:
    return rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])
