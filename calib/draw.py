"""Pictures of the stops: what was detected, what the calibration expects, and how far apart they are."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import CalibError
from calib.exports.scene import FULL_SCALE_PX, MAGNIFIED, residual_colours
from calib.frames import Array
from calib.report.seen import SeenStop, stops_seen
from calib.result import Calibration
from detect.correspondences import Correspondences
from detect.extract import frames_at
from detect.messages import Grey
from detect.names import Topics
from detect.recording import Recording, open_recording
from detect.stops import Stop, find_stops
from detect.tags import Tags, find_tags
from target.box import Target

Picture = NDArray[np.uint8]
"""A colour image (H, W, 3), blue first."""

_WIDTH_PX = 1280
_SETTLE = 0.1
_SHIFT = 4
_LONGEST_PX = 60.0
_MIRRORED_TAGS = 4
_WHITE, _BLACK, _CYAN = (255.0, 255.0, 255.0), (0.0, 0.0, 0.0), (255.0, 255.0, 0.0)


def draw_stops(
    log: Path,
    target: Target,
    *,
    topics: Topics | None = None,
    calibration: Calibration | None = None,
    drive: Correspondences | None = None,
) -> Iterator[tuple[str, bytes]]:
    """Yield file name and JPEG of each stop of a log.

    With a calibration: the corners that it was made from, and where it expects them. Without one (the robot failed):
    the tags that are detected, so that a wrong board, a mirrored print or a dark image is seen.

    Parameters
    ----------
    log
        The recording (MCAP).
    target
        The box.
    topics
        Names where the log is ambiguous.
    calibration, drive
        The robot's calibration and the correspondences that it was made from; both or none.

    Raises
    ------
    CalibError
        If the log is not a recording.
    DetectError
        If it cannot be read.
    """
    if log.suffix != ".mcap":
        raise CalibError(f"{log.name}: holds no images, a recording (.mcap) is needed to draw its stops; give that")
    recording = open_recording(log, topics)
    if calibration is not None and drive is not None:
        seen = {stop.number: stop for stop in stops_seen(calibration, drive, target)}
        for number, view in enumerate(drive.stops):
            frame = stop_frame(recording, view.t_start_ns, view.t_end_ns)
            if frame is not None:
                yield f"stop-{number + 1:02d}.jpg", jpeg(paint_stop(frame[1], number, seen.get(number), view.uv_px))
        return
    for number, stop in enumerate(find_stops(recording.wheels, None, recording.encoder_steps)):
        frame = stop_frame(recording, stop.t_start_ns, stop.t_end_ns)
        if frame is not None:
            tags = find_tags(frame[1], target)
            mirrored = len(tags.ids) == 0 and len(find_tags(_mirrored(frame[1]), target).ids) >= _MIRRORED_TAGS
            yield f"stop-{number + 1:02d}.jpg", jpeg(paint_tags(frame[1], number, tags, mirrored=mirrored))


def stop_jpegs(log: Path, stops: Sequence[SeenStop], *, topics: Topics | None = None) -> dict[int, tuple[int, bytes]]:
    """Return time (ns) and JPEG of one frame of each stop, by the stop's number; none of correspondences saved before.

    Raises
    ------
    DetectError
        If the log cannot be read.
    """
    if log.suffix != ".mcap":
        return {}
    recording = open_recording(log, topics)
    frames = {s.number: stop_frame(recording, s.view.t_start_ns, s.view.t_end_ns) for s in stops}
    return {number: (frame[0], jpeg(frame[1])) for number, frame in frames.items() if frame is not None}


def stop_frame(recording: Recording, t_start_ns: int, t_end_ns: int) -> tuple[int, Grey] | None:
    """Return time and image of the middle frame of a stop, None if there is none."""
    stop = Stop(t_start_ns=t_start_ns, t_end_ns=t_end_ns, first_sample=0, last_sample=0, phi_R=0.0, phi_L=0.0)
    frames = frames_at(recording, stop, _SETTLE, 3)
    return next(recording.read_frames(frames[[len(frames) // 2]]), None) if frames.size else None


def paint_stop(image: Grey, number: int, seen: SeenStop | None, uv_px: Array) -> Picture:
    """Return a stop's image with its corners.

    Circles: detected corners. Crosses: where the calibration expects them. Lines: detected less expected, 20 times as
    long. Green to red: 0 to 1 px; magenta: left out. White circles: a stop that was not used.
    """
    k, picture = _enlarged(image)
    if seen is None:
        for at in uv_px:
            _circle(picture, at, k, _WHITE)
        return _labelled(picture, f"stop {number + 1}: not used")
    lengths = np.linalg.norm(seen.error_px, axis=1)
    colours = residual_colours(seen.error_px, seen.used)[:, ::-1] * 255
    for at, error, length, colour in zip(seen.view.uv_px, seen.error_px, lengths, colours, strict=True):
        shade = (float(colour[0]), float(colour[1]), float(colour[2]))
        if np.isfinite(length):
            _cross(picture, at - error, k, shade)
            reach = min(MAGNIFIED, max(1.0, _LONGEST_PX / max(float(length), 1e-9)))
            _line(picture, at - error, at - error + reach * error, k, shade)
        _circle(picture, at, k, shade)
    rms = np.sqrt(np.mean(lengths[seen.used] ** 2)) if np.any(seen.used) else np.nan
    out = int(np.sum(~seen.used))
    return _labelled(
        picture,
        f"stop {number + 1}: {len(lengths)} corners, {out} left out (magenta), {rms:.3f} px rms; "
        f"green 0 to red {FULL_SCALE_PX:g} px, lines x {MAGNIFIED:g}",
    )


def paint_tags(image: Grey, number: int, tags: Tags, *, mirrored: bool = False) -> Picture:
    """Return a stop's image with the tags detected in it: outlines, first corners and ids.

    ``mirrored`` says that tags were found in the mirror image only.
    """
    k, picture = _enlarged(image)
    for tag, corners in zip(tags.ids, tags.corners_px, strict=True):
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            _line(picture, a, b, k, _CYAN)
        _circle(picture, corners[0], k, _CYAN)
        x, y = ((corners.mean(axis=0) + 0.5) * k).astype(int).tolist()
        cv2.putText(picture, str(int(tag)), (x - 10, y + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _CYAN, 1, cv2.LINE_AA)
    foreign = f", {len(tags.foreign_ids)} tags of another target" if len(tags.foreign_ids) else ""
    mirror = "; the tags are MIRRORED, print them again" if mirrored else ""
    return _labelled(picture, f"stop {number + 1}: {len(tags.ids)} tags of the target{foreign}{mirror}; no calibration")


def jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Return an image as JPEG."""
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()


def _mirrored(image: Grey) -> Grey:
    return np.ascontiguousarray(image[:, ::-1])


def _enlarged(image: Grey) -> tuple[int, Picture]:
    k = max(1, round(_WIDTH_PX / image.shape[1]))
    large = cv2.resize(image, None, fx=k, fy=k, interpolation=cv2.INTER_NEAREST)
    return k, np.ascontiguousarray(cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _at(uv_px: Array, k: int) -> tuple[int, int]:
    """Return where a pixel's position lies in the enlarged image, in the fixed point of OpenCV's drawing."""
    u, v = np.clip(((uv_px + 0.5) * k - 0.5) * 2**_SHIFT, -(2**24), 2**24)
    return round(float(u)), round(float(v))


def _circle(picture: Picture, uv_px: Array, k: int, colour: tuple[float, float, float]) -> None:
    cv2.circle(picture, _at(uv_px, k), 5 << _SHIFT, colour, 1, cv2.LINE_AA, _SHIFT)


def _line(picture: Picture, a: Array, b: Array, k: int, colour: tuple[float, float, float]) -> None:
    cv2.line(picture, _at(a, k), _at(b, k), colour, 1, cv2.LINE_AA, _SHIFT)


def _cross(picture: Picture, uv_px: Array, k: int, colour: tuple[float, float, float]) -> None:
    for d in ((3.0 / k, 3.0 / k), (3.0 / k, -3.0 / k)):
        _line(picture, uv_px - d, uv_px + d, k, colour)


def _labelled(picture: Picture, text: str) -> Picture:
    bar = np.zeros((24, picture.shape[1], 3), dtype=np.uint8)
    cv2.putText(bar, text, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _WHITE, 1, cv2.LINE_AA)
    return np.concatenate([picture, bar])
