"""One stop measured once: its frames averaged, and the tags of the box aligned in the mean image.

A mean over n frames has a root of n less noise than one of them, costs one detection instead of n, and what does not
change from frame to frame (the pixel grid, the print, the lens) shows in its residuals instead of hiding below noise.
Frames that do not show the same still image are left out (:mod:`boxcal.detect.tags.stillness`). The next stop starts
from the camera that this one found: its focal length and distortion, response curve and PSF.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.detection import KnownCamera
from boxcal.detect.alignment.detector import detect_in_grey
from boxcal.detect.alignment.expected_tags import ExpectedTags
from boxcal.detect.image.bayer import even_mosaic, unnamed_mosaic
from boxcal.detect.image.bit_depth import FULL_SCALE, DeepGrey
from boxcal.detect.image.gray import LEAST_SIDE_PX, eight_bit_copy
from boxcal.detect.tags.averaging import AveragedCorners, combine
from boxcal.detect.tags.detections import TagDetections, TagSettings, detector_settings, find_tags, foreign_tags
from boxcal.detect.tags.stillness import Stillness, compare_frames
from boxcal.target.box import Target

MOST_BYTES = 1 << 27
"""Frames of a stop held at once; beyond it further frames are not read."""
EXPOSURE = 0.005
"""Gains closer to one are noise of the fit: the frames are averaged as they are."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StopMeasurement:
    """Measurement of one stop from its frames.

    Attributes
    ----------
    corners
        Where each landmark was seen, and how well.
    foreign_ids : (M,)
        Tags of the target's family that the target does not carry, looked for only where none of its own was seen.
    left_out
        How many frames were left out and why, as a phrase; empty if none was.
    camera
        For the next stop; None where nothing is known yet.
    settled
        Whether most frames show one image, as they do at rest.
    rejected_ids : (R,)
        Tags of the target that were read but do not lie where the box has them.
    picture
        In which they were measured; None where tags were found frame by frame.
    """

    corners: AveragedCorners
    foreign_ids: NDArray[np.int64]
    left_out: str
    camera: KnownCamera | None
    settled: bool
    rejected_ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    picture: "MeanPicture | None" = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeanPicture:
    """Mean of the frames of a stop that show one still image.

    Attributes
    ----------
    mean : (H, W)
        In the frames' grey levels.
    full
        Their full scale.
    still
        Which of them show that image.
    frames
        How many there were.
    example : (H, W)
        One of them, in which foreign tags are looked for where none of the target's is seen; None where it is not kept.
    """

    mean: NDArray[np.float32]
    full: float
    still: Stillness
    frames: int
    example: DeepGrey | None = None


def measure_stop(
    frames: Iterable[DeepGrey],
    target: Target,
    settings: TagSettings | None = None,
    camera: KnownCamera | None = None,
) -> StopMeasurement:
    """Measure the tags of a target in the frames that were taken while the robot stood still once.

    Parameters
    ----------
    frames
        Grey images (H, W) of one size, uint8 or uint16 (white at 65535); read one after the other.
    target
        The box to look for.
    settings
        The defaults if None. If they are not ``accurate``, tags are found frame by frame and averaged.
    camera
        What is known of the camera from the stop before; the first stop has none.
    """
    settings = settings or TagSettings()
    held = _held(frames)
    if not held:
        return _measured(combine([]), camera=camera)
    if not settings.accurate or min(held[0].shape) < LEAST_SIDE_PX:
        by_frame = [find_tags(frame, target, settings) for frame in held]
        foreign = np.unique(np.concatenate([t.foreign_ids for t in by_frame]))
        return _measured(combine(by_frame), foreign_ids=foreign, camera=camera)
    mosaic = unnamed_mosaic(held[0])
    if mosaic is not None:
        held = [even_mosaic(frame, mosaic) for frame in held]
    mean, still = average_frames(held)
    full = 255.0 if held[0].dtype == np.uint8 else float(FULL_SCALE)
    picture = MeanPicture(mean=mean, full=full, still=still, frames=len(held), example=held[len(held) // 2])
    return measure_picture(picture, target, settings, camera)


def measure_picture(
    picture: MeanPicture,
    target: Target,
    settings: TagSettings,
    camera: KnownCamera | None = None,
    expected: ExpectedTags | None = None,
) -> StopMeasurement:
    """Measure the tags of a target in the mean image of a stop, where they are expected if it was measured before."""
    full, still = picture.full, picture.still
    grey = np.multiply(picture.mean, np.float32(1 / full), dtype=np.float32)
    grey8 = eight_bit_copy(picture.mean, full)
    found = detect_in_grey(grey, grey8, target, detector_settings(settings), camera, expected)
    if found.ids.size == 0:
        nothing = np.zeros(0, dtype=np.int64)
        foreign = nothing if picture.example is None else foreign_tags(picture.example, target, settings)
        corners = combine([TagDetections.none()] * picture.frames)
        return replace(_measured(corners, foreign_ids=foreign, still=still, camera=camera), picture=picture)
    kept, landmarks = int(still.kept.sum()), 4 * found.ids.size
    corners = AveragedCorners(
        landmark_ids=(4 * found.ids[:, None] + np.arange(4)).ravel(),
        uv_px=found.corners_px.reshape(-1, 2),
        sigma_px=np.zeros(landmarks),
        cov_px2=found.cov_px2.reshape(-1, 2, 2) + still.displacement_px2,
        counts=np.full(landmarks, kept, dtype=np.int64),
        scatter_px2=np.zeros((2, 2)),
        normalised=0.0,
        freedom=0,
        frames=kept,
        of_mean=True,
        averages_out=_averages_out(still.noise / full, found.residual, kept),
    )
    measured = _measured(corners, still=still, camera=_newer(camera, found.camera))
    return replace(measured, rejected_ids=found.rejected_ids, picture=picture)


def average_frames(frames: list[DeepGrey]) -> tuple[NDArray[np.float32], Stillness]:
    """Return the mean of the frames that show the same still image, (H, W) in their grey levels, and which those are.

    Each frame is brought to the exposure of the median frame first.
    """
    mean = _mean(frames)
    still = compare_frames(frames, mean)
    kept = np.flatnonzero(still.kept)
    exposed = np.abs(still.gain[kept] - 1).max() > EXPOSURE
    if len(kept) < len(frames) or exposed:
        gain, offset = (still.gain, still.offset) if exposed else (np.ones(len(frames)), np.zeros(len(frames)))
        mean = _mean([frames[k] for k in kept], gain[kept], offset[kept])
    return mean, still


def _mean(
    frames: list[DeepGrey], gain: NDArray[np.float64] | None = None, offset: NDArray[np.float64] | None = None
) -> NDArray[np.float32]:
    """Return the mean of frames; with gains and offsets, of what each would be at gain 1 and offset 0, by its noise."""
    total = np.zeros(frames[0].shape, dtype=np.float32)
    if gain is None or offset is None:
        for frame in frames:
            cv2.accumulate(frame, total)
        return np.asarray(total * np.float32(1 / len(frames)))
    for frame, weight in zip(frames, (gain / np.cumsum(gain)).tolist(), strict=True):
        cv2.accumulateWeighted(frame, total, weight)  # the mean by gains of those so far
    scale = float(gain.sum() / (gain @ gain))
    return np.asarray(total * np.float32(scale) - np.float32(gain @ offset / (gain @ gain)))


def _averages_out(noise: float, residual: NDArray[np.float64], frames: int) -> float:
    """Return the fraction of the residuals' variance in a mean image that is noise; the rest stays in every frame."""
    if frames < 2:
        return float("nan")
    return float(np.clip(np.median(noise**2 / frames / np.maximum(residual, 1e-9) ** 2), 0, 1))


def _held(frames: Iterable[DeepGrey]) -> list[DeepGrey]:
    held: list[DeepGrey] = []
    size = 0
    for frame in frames:
        held.append(frame)
        size += frame.nbytes
        if size > MOST_BYTES:
            break
    return held


def _newer(old: KnownCamera | None, new: KnownCamera | None) -> KnownCamera | None:
    """Return what is known of the camera after a stop; a response curve once clearly determined stays."""
    if new is None or old is None:
        return new or old
    return replace(new, imaging=replace(new.imaging, response=old.imaging.response)) if old.imaging.settled else new


def _measured(
    corners: AveragedCorners,
    *,
    foreign_ids: NDArray[np.int64] | None = None,
    still: Stillness | None = None,
    camera: KnownCamera | None = None,
) -> StopMeasurement:
    return StopMeasurement(
        corners=corners,
        foreign_ids=np.zeros(0, dtype=np.int64) if foreign_ids is None else foreign_ids,
        left_out="" if still is None else still.left_out,
        camera=camera,
        settled=still is None or still.settled,
    )
