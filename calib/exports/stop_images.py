"""Images of the stops: what was detected, what the calibration expects, and how far apart they are."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.scene import FULL_SCALE_PX, MAGNIFIED, Images, residual_colours
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.stop_residuals import SeenStop, stop_label, stops_seen
from boxcal.calib.settings import CORRESPONDENCES
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.extract import frames_at
from boxcal.detect.log.images import Grey
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import WheelUnits
from boxcal.detect.stops import Stop, find_stops
from boxcal.detect.tags.detections import TagDetections, find_tags
from boxcal.target.arrays import Array
from boxcal.target.box import Target

Picture = NDArray[np.uint8]
"""A colour image (H, W, 3), blue first."""

_WIDTH_PX = 1280
_SETTLE = 0.1
_SHIFT = 4
_LONGEST_PX = 60.0
_MIRRORED_TAGS = 4
_WHITE, _BLACK, _CYAN = (255.0, 255.0, 255.0), (0.0, 0.0, 0.0), (255.0, 255.0, 0.0)


def draw_stops(
    logs: Sequence[Path],
    target: Target,
    *,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    calibration: Calibration | None = None,
    drives: Sequence[Correspondences] = (),
) -> Iterator[tuple[str, bytes]]:
    """Yield file name and JPEG of each stop of a robot's logs.

    With a calibration: the corners that it was made from, and where it expects them. Without one (the robot failed):
    the tags that are detected, so that a wrong board, a mirrored print or a dark image is seen.

    Parameters
    ----------
    logs
        The recordings (MCAP).
    target
        The box.
    topics
        Names where a log is ambiguous.
    units
        What the wheel readings mean.
    calibration, drives
        The robot's calibration and the correspondences that it was made from, one of each log; or neither.

    Raises
    ------
    CalibError
        If a log is not a recording.
    DetectError
        If it cannot be read.
    """
    seen = {(s.drive, s.number): s for s in stops_seen(calibration, drives, target)} if calibration else {}
    for d, log in enumerate(logs):
        if log.suffix == CORRESPONDENCES:
            raise CalibError(
                "holds no images, a recording is needed to draw its stops", source=log.name, remedy="give that"
            )
        recording = opened(log, topics, units, drives[d] if d < len(drives) else None)
        views: Sequence[StopObservation | Stop] = drives[d].stops if calibration else find_stops(recording.wheels)
        for j, view in enumerate(views):
            frame = stop_frame(recording, view.t_start_ns, view.t_end_ns)
            if frame is None:
                continue
            label = stop_label(d, j, several=len(logs) > 1)
            picture = (
                paint_stop(frame[1], label, seen.get((d, j)), view.uv_px)
                if isinstance(view, StopObservation)
                else _paint_found(frame[1], label, target)
            )
            yield f"{f'drive-{d + 1}-' if len(logs) > 1 else ''}stop-{j + 1:02d}.jpg", jpeg(picture)


def stop_jpegs(
    logs: Sequence[Path],
    stops: Sequence[SeenStop],
    *,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    drives: Sequence[Correspondences] = (),
) -> Images:
    """Return time (ns) and JPEG of one frame of each stop; none of correspondences saved before.

    Raises
    ------
    DetectError
        If a log cannot be read.
    """
    found = {}
    for d, log in enumerate(logs):
        drive = drives[d] if d < len(drives) else None
        recording = None if log.suffix == CORRESPONDENCES else opened(log, topics, units, drive)
        for s in stops:
            frame = stop_frame(recording, s.view.t_start_ns, s.view.t_end_ns) if recording and s.drive == d else None
            if frame is not None:
                found[d, s.number] = (frame[0], jpeg(frame[1]))
    return found


def opened(log: Path, topics: Topics | None, units: WheelUnits | None, drive: Correspondences | None) -> Recording:
    """Open a log with its frames at the times that they had when the drive was extracted from it."""
    recording = open_recording(log, topics, units, hashed=False)
    if drive is None:
        return recording
    offset = round(drive.source.clock_offset * 1e9) - recording.clock_offset_ns
    return recording.with_clock_offset(offset) if offset else recording


def stop_frame(recording: Recording, t_start_ns: int, t_end_ns: int) -> tuple[int, Grey] | None:
    """Return time and image of the middle frame of a stop, None if there is none."""
    stop = Stop(t_start_ns=t_start_ns, t_end_ns=t_end_ns, first_sample=0, last_sample=0, phi_R=0.0, phi_L=0.0)
    frames = frames_at(recording, stop, _SETTLE, 3)
    return next(recording.read_frames(frames[[len(frames) // 2]]), None) if frames.size else None


def paint_stop(image: Grey, label: str, seen: SeenStop | None, uv_px: Array) -> Picture:
    """Return a stop's image with its corners.

    Circles: detected corners. Crosses: where the calibration expects them. Lines: detected less expected, 20 times as
    long. Green to red: 0 to 1 px; magenta: left out. White circles: a stop that was not used.
    """
    k, picture = _enlarged(image)
    if seen is None:
        for at in uv_px:
            _circle(picture, at, k, _WHITE)
        return _labelled(picture, f"stop {label}: not used")
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
        f"stop {label}: {len(lengths)} corners, {out} left out (magenta), {rms:.3f} px rms; "
        f"green 0 to red {FULL_SCALE_PX:g} px, lines x {MAGNIFIED:g}",
    )


def paint_tags(image: Grey, label: str, tags: TagDetections, *, mirrored: bool = False) -> Picture:
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
    return _labelled(picture, f"stop {label}: {len(tags.ids)} tags of the target{foreign}{mirror}; no calibration")


def jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Return an image as JPEG."""
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()


def _paint_found(image: Grey, label: str, target: Target) -> Picture:
    tags = find_tags(image, target)
    mirrored = len(tags.ids) == 0 and len(find_tags(_mirrored(image), target).ids) >= _MIRRORED_TAGS
    return paint_tags(image, label, tags, mirrored=mirrored)


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
