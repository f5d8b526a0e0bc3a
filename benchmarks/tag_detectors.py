"""The detectors that the benchmarks compare, and how what they find is scored."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from tag_scenes import TARGET, Grey, Scene  # isort: skip - sets one thread before numpy counts them

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.detection import DetectorSettings, KnownCamera
from boxcal.detect.alignment.detector import detect_tags
from boxcal.detect.alignment.expected_tags import ExpectedTags
from boxcal.target.arrays import Array
from boxcal.target.tags.families import load_dictionary

Found = tuple[NDArray[np.int64], Array, Array | None]
"""Ids (N,), corners (N, 4, 2) px, covariances (N, 4, 2, 2) px^2 if the detector gives any."""
Detector = Callable[[Grey], Found]
GATE_PX = 3.0
"""A corner that is further off is wrong, not inaccurate."""
OURS, FAST = "boxcal accurate", "boxcal fast"


@dataclass(slots=True)
class Score:
    """What a detector did on a set of scenes."""

    wanted: int = 0
    found: int = 0
    wrong: int = 0
    errors: list[Array] = field(default_factory=list)
    normalised: list[Array] = field(default_factory=list)
    shrink: list[Array] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    @property
    def recall(self) -> float:
        """Fraction of the wanted tags that were found."""
        return self.found / max(self.wanted, 1)

    @property
    def rms_px(self) -> float:
        """Root mean square of the corners' distances from the truth."""
        errors = np.concatenate(self.errors) if self.errors else np.zeros((0, 4, 2))
        return float(np.sqrt((errors**2).sum(axis=2).mean())) if len(errors) else float("nan")

    @property
    def spread(self) -> float:
        """Deviation of the errors over what the detector claims."""
        return float(np.concatenate(self.normalised).std()) if self.normalised else float("nan")


def opencv(method: int, window: int | None = None) -> Detector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = method
    if window:
        parameters.cornerRefinementWinSize = window
        parameters.relativeCornerRefinmentWinSize = 1.0
    detector = cv2.aruco.ArucoDetector(load_dictionary(TARGET.box.dictionary), parameters)

    def detect(image: Grey) -> Found:
        corners, ids, _ = detector.detectMarkers(image)
        if ids is None or len(ids) == 0:
            return np.zeros(0, np.int64), np.zeros((0, 4, 2)), None
        return np.ravel(ids).astype(np.int64), np.array(corners, dtype=np.float64).reshape(-1, 4, 2), None

    return detect


def apriltags(module: str) -> Detector:
    """Return the AprilTag library's detector; its pixel origin is the corner of the first pixel."""
    library = __import__(module)
    detector = library.Detector(families="tag36h11", quad_decimate=1.0, nthreads=1)

    def detect(image: Grey) -> Found:
        found = detector.detect(np.ascontiguousarray(image))
        if not found:
            return np.zeros(0, np.int64), np.zeros((0, 4, 2)), None
        corners = np.array([tag.corners for tag in found], dtype=np.float64).reshape(-1, 4, 2)
        return np.array([tag.tag_id for tag in found], dtype=np.int64), corners - 0.5, None

    return detect


def ours(
    settings: DetectorSettings, camera: KnownCamera | None = None, expected: ExpectedTags | None = None
) -> Detector:
    def detect(image: Grey) -> Found:
        tags = detect_tags(image, TARGET, settings, camera=camera, expected=expected)
        return tags.ids, tags.corners_px, tags.cov_px2

    return detect


def detectors() -> tuple[dict[str, Detector], list[str]]:
    """Return the detectors that can run here, and the names of those that cannot."""
    chosen: dict[str, Detector] = {
        "OpenCV, no refinement": opencv(cv2.aruco.CORNER_REFINE_NONE),
        "OpenCV SUBPIX (default)": opencv(cv2.aruco.CORNER_REFINE_SUBPIX),
        "OpenCV SUBPIX, window 2": opencv(cv2.aruco.CORNER_REFINE_SUBPIX, 2),
        "OpenCV APRILTAG": opencv(cv2.aruco.CORNER_REFINE_APRILTAG),
    }
    absent = ["napa-vision (licence)"]
    for module in ("pupil_apriltags", "pyapriltags"):
        try:
            chosen[module.replace("_", "-")] = apriltags(module)
        except ImportError:
            absent.append(module)
    chosen[FAST] = ours(DetectorSettings(fast=True))
    chosen[OURS] = ours(DetectorSettings())
    return chosen, absent


def run(detect: Detector, made: Sequence[Scene], repeat: int = 1) -> Score:
    """Return what a detector does; corners are taken in the cyclic order that fits best, as libraries differ in it."""
    score = Score()
    for scene in made:
        times = []
        for _ in range(repeat):
            start = time.process_time()
            ids, corners, cov = detect(scene.image)
            times.append(time.process_time() - start)
        score.seconds.append(min(times))
        known = ids < len(scene.uv_px)
        score.wrong += int(np.sum(~known))
        ids, corners, cov = ids[known], corners[known], None if cov is None else cov[known]
        orders = [[(s + k * d) % 4 for k in range(4)] for s in range(4) for d in (1, -1)]
        off = np.array([np.abs(corners[:, order] - scene.uv_px[ids]).max(axis=(1, 2)) for order in orders])
        if len(ids) and cov is None:
            corners = np.stack([c[orders[k]] for c, k in zip(corners, off.argmin(axis=0), strict=True)])
        error = corners - scene.uv_px[ids]
        good = (np.linalg.norm(error, axis=2).max(axis=1) < GATE_PX) & ~np.isin(ids, scene.covered)
        score.wrong += int(np.sum(~good))
        good &= np.isin(ids, scene.wanted)
        score.wanted += len(scene.wanted)
        score.found += len(np.unique(ids[good]))
        score.errors.append(error[good])
        outward = scene.uv_px[ids[good]] - scene.uv_px[ids[good]].mean(axis=1, keepdims=True)
        outward /= np.linalg.norm(outward, axis=2, keepdims=True)
        score.shrink.append(-np.sum(error[good] * outward, axis=2).ravel())
        if cov is not None and good.any():
            half = np.linalg.cholesky(cov[good])
            score.normalised.append(np.linalg.solve(half, error[good][..., None])[..., 0].ravel())
    return score
