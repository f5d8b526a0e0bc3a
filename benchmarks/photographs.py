"""Corners in photographs that no one here took: ours, the AprilTag library's, and how far each can be believed.

python benchmarks/photographs.py

The reference file holds the library's corners without edge refinement. Photographs have no truth; so tags are drawn
into them where ours found them, with their own blur, light and surroundings, and the library is asked again: what it is
off there, where the truth is known, it may be off on the photographs. Needs shared/data beside the project and the
extra ``bench``.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from boxcal.detect.alignment.detection import DetectorSettings
from boxcal.detect.alignment.detector import detect_copies
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.begin import footprints
from boxcal.detect.alignment.registration.image_model import differentiate
from boxcal.detect.alignment.registration.parameters import LOG_PSF
from boxcal.detect.alignment.registration.tag_batch import Batch, Frame
from boxcal.detect.alignment.tag_patterns import Patterns, family_patterns
from boxcal.detect.image.gray import to_grey
from boxcal.detect.image.response_curve import response_table

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "photos"
PATTERNS = family_patterns("DICT_APRILTAG_36h11", np.arange(1))
ORDERS = [[(s + k * d) % 4 for k in range(4)] for s in range(4) for d in (1, -1)]
NEAR_PX = 4.0


def library(grey: NDArray[np.uint8], *, refined: bool) -> Array:
    """Return the AprilTag library's corners (N, 4, 2) in px, the first pixel's centre at 0."""
    import pyapriltags  # noqa: PLC0415 - an extra

    detector = pyapriltags.Detector(families="tag36h11", quad_decimate=1.0, refine_edges=int(refined), nthreads=1)
    return np.array([tag.corners for tag in detector.detect(grey)]).reshape(-1, 4, 2) - 0.5


def matched(corners: Array, wanted: Array) -> Array:
    """Return for each wanted tag (T, 4, 2) the one found at its place, in its order of corners; NaN where none is."""
    out = np.full(wanted.shape, np.nan)
    for k, tag in enumerate(wanted):
        apart = np.linalg.norm(corners.mean(axis=1) - tag.mean(axis=0), axis=1)
        if len(apart) and apart.min() < NEAR_PX:
            found = corners[apart.argmin()]
            out[k] = min((found[o] for o in ORDERS), key=lambda c: float(np.abs(c - tag).max()))
    return out


def redrawn(grey: NDArray[np.uint8], patterns: Patterns, corners: Array) -> tuple[NDArray[np.uint8], Array]:
    """Return the image with what the model sees of the tags drawn over them, and their corners there."""
    levels, _ = to_grey(grey)
    frame = Frame(grey=levels, response=response_table("linear"), lens=no_distortion((grey.shape[1], grey.shape[0])))
    tags = align(frame, patterns, np.zeros(len(corners), dtype=np.int64), corners, stop_px=1e-3, iterations=30)
    blur = tags.theta[:, LOG_PSF]
    boxes, margin, _, near, _ = footprints(frame, patterns, tags.corners_px, blur, side_px=np.inf, edges=True)
    batch = Batch(
        frame=frame,
        cells=patterns.cells,
        rows=tags.rows,
        theta=tags.theta,
        normalisation=tags.normalisation,
        bounding_boxes=boxes,
        margin=margin,
        stride=np.ones((len(tags), 3), dtype=np.int64),
        near=near,
    )
    picture = grey.copy()
    for k in range(len(tags)):
        seen = differentiate(batch, k)
        if seen is not None:
            picture[seen.lines, seen.columns] = np.clip(np.rint(seen.predicted * 255), 0, 255)
    return picture, tags.corners_px


def load(path: Path) -> tuple[NDArray[np.uint8], Array]:
    """Return a photograph in grey and its reference, moved to where the first pixel's centre is 0."""
    lines = [line for line in path.with_suffix(".txt").read_text().split("\n") if line.strip()]
    numbers = [line.replace("(", " ").replace(")", " ").replace(",", " ").split()[1:] for line in lines]
    grey = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return grey, np.array(numbers, dtype=np.float64).reshape(-1, 4, 2) - 0.5


def row(name: str, corners: Array, truth: Array) -> None:
    """Print how far corners lie from others: (T, 4, 2) each, NaN where there are none."""
    here = np.isfinite(corners).all(axis=(1, 2)) & np.isfinite(truth).all(axis=(1, 2))
    off = (corners - truth)[here]
    most = np.abs(off).max(axis=(1, 2))
    figures = [
        f"{here.sum()}", f"{np.sqrt((off**2).sum(axis=2).mean()):.3f}", f"{np.median(most):.3f}",
        f"{np.quantile(most, 0.9):.3f}", f"{most.max():.2f}", f"{np.mean(np.abs(off).max(axis=2) < 0.5):.2f}",
        f"{np.mean(most < 0.5):.2f}", f"{off[..., 1].mean():+.3f}",
    ]  # fmt: skip
    print(f"| {name} | " + " | ".join(figures) + " |")


def main() -> int:
    """Print the table."""
    if not DATA.is_dir():
        print("no shared data beside the project: there are no photographs to look at")
        return 0
    seen: dict[str, list[Array]] = {k: [] for k in ("reference", "ours", "plain", "refined", "truth", "p", "r", "o")}
    for path in sorted(DATA.glob("*.jpg")):
        grey, reference = load(path)
        found = detect_copies(grey, PATTERNS, DetectorSettings(response="linear")).corners_px
        picture, drawn = redrawn(grey, PATTERNS, found)
        ours, truth = matched(found, reference), matched(drawn, reference)
        for key, corners, wanted in (
            ("reference", reference, reference),
            ("ours", ours, reference),
            ("plain", library(grey, refined=False), reference),
            ("refined", library(grey, refined=True), reference),
            ("truth", truth, truth),
            ("p", library(picture, refined=False), truth),
            ("r", library(picture, refined=True), truth),
            ("o", detect_copies(picture, PATTERNS, DetectorSettings(response="linear")).corners_px, truth),
        ):
            seen[key].append(matched(corners, wanted))
    every = {key: np.concatenate(parts) for key, parts in seen.items()}
    print("| corners | tags | rms px | a tag's most: median | 90 % | most | corners in .5 | tags in .5 | mean v |")
    print("|---|---|---|---|---|---|---|---|---|")
    row("library unrefined, against the reference", every["plain"], every["reference"])
    row("library refined, against the reference", every["refined"], every["reference"])
    row("ours, against the reference", every["ours"], every["reference"])
    row("ours, against the library refined", every["ours"], every["refined"])
    row("library unrefined, against the redrawn truth", every["p"], every["truth"])
    row("library refined, against the redrawn truth", every["r"], every["truth"])
    row("ours, against the redrawn truth", every["o"], every["truth"])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
