"""Hard pictures: recall and errors beside the best peer, where light, paper, lens or sensor are unkind.

python benchmarks/hard_pictures.py

prints the table of hard pictures in docs/detector.md. Most are rendered (:mod:`hard_scenes`, several views each); those
of ``shared/cases/pictures`` beside the project, each with its truth, follow where they are present. Wanted are tags
wider than 10 px on faces seen within 60 degrees (of the cases: all that the truth has); normalised errors have a
deviation of one where the covariances are right. Behind ± stands that deviation's own error, as the views differ.

    python benchmarks/hard_pictures.py --waves

prints what corners err on paper with higher and lower, shorter and longer waves, and what they would if it were taken
for flat.
"""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from unittest.mock import patch

from hard_scenes import finer, rendered, wrinkled  # isort: skip - sets one thread before numpy counts them
from tag_scenes import TARGET, Scene, width_px  # isort: skip

import cv2
import numpy as np
from tag_detectors import FAST, OURS, Score, detectors, ours, run

from boxcal.detect.alignment.detection import DetectorSettings

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases" / "pictures"
PEERS = ("OpenCV SUBPIX (default)", "OpenCV, no refinement", "pyapriltags", "pupil-apriltags")
LEAST_WIDTH_PX = 10.0
WAVE_LENGTHS, WAVE_HEIGHTS_MM = (0.25, 0.5, 1.0), (0.1, 0.2, 0.4, 0.8)


def cases() -> Iterator[tuple[str, Callable[[], list[Scene]]]]:
    """Yield the images of ``shared/cases``; none where they are absent."""
    for truth in sorted(CASES.glob("*.truth.json")):
        name = truth.name.removesuffix(".truth.json")
        picture = next(p for p in sorted(CASES.glob(f"{name}.*")) if p.suffix in {".png", ".jpg"})
        image = np.asarray(cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
        yield f"case {name}", lambda i=image, t=truth: [case(i, json.loads(t.read_text()))]


def case(image: np.ndarray, corners: dict[str, list[list[float]]]) -> Scene:
    """Return an image with the corners of the tags that its truth has; nothing is known of others."""
    uv = np.full((len(TARGET.tag_ids), 4, 2), np.nan)
    for tag, places in corners.items():
        uv[int(tag)] = places
    width = np.nan_to_num(width_px(np.nan_to_num(uv)))
    return Scene(image=image, wanted=np.flatnonzero(width >= LEAST_WIDTH_PX), uv_px=uv, width_px=width)


def only_known(detect: Callable, scene: Scene) -> Callable:
    """Return a detector whose tags without a truth are passed over: they are neither right nor wrong."""

    def known(image: np.ndarray) -> tuple:
        ids, corners, cov = detect(image)
        told = (ids < len(scene.uv_px)) & np.isfinite(scene.uv_px[np.minimum(ids, len(scene.uv_px) - 1), 0, 0])
        return ids[told], corners[told], None if cov is None else cov[told]

    return known


def deviation_error(score: Score) -> float:
    """Return the standard error of the deviation of normalised errors, by leaving out one image after the other."""
    squares = np.array([np.sum(z**2) for z in score.normalised])
    counts = np.array([z.size for z in score.normalised])
    n = len(counts)
    if n < 2:
        return float("nan")
    without = np.sqrt((squares.sum() - squares) / (counts.sum() - counts))
    return float(np.sqrt((n - 1) * np.var(without)))


def waves(views: int, seed: int) -> None:
    """Print errors on paper whose waves are of several heights and lengths."""
    print("| length, sides | height, mm | tags | recall | rms px | taken for flat | sigma |")
    print("|---|---|---|---|---|---|---|")
    for length, height_mm in product(WAVE_LENGTHS, WAVE_HEIGHTS_MM):
        made = finer(views, seed, light=partial(wrinkled, height_mm=height_mm, length=length))
        own = run(ours(DetectorSettings()), made)
        with patch("boxcal.detect.alignment.detector.deformation", return_value=None):
            flat = run(ours(DetectorSettings()), made)
        cells = f"{own.wanted} | {own.recall:.3f} | {own.rms_px:.4f} | {flat.rms_px:.4f} | {own.spread:.2f}"
        print(f"| {length:g} | {height_mm:g} | {cells} ± {deviation_error(own):.2f} |", flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=12, help="rendered views of each set (12)")
    parser.add_argument("--seed", type=int, default=140, help="of the first set (140)")
    parser.add_argument("--only", default="", help="sets whose names hold one of these, separated by commas")
    parser.add_argument("--waves", action="store_true", help="only paper with waves of several heights and lengths")
    options = parser.parse_args(argv)
    cv2.setNumThreads(1)
    if options.waves:
        waves(options.views, options.seed)
        return 0
    chosen = detectors()[0]
    print("| picture | tags | best peer's recall | recall | wrong | rms px | sigma | fast: recall, rms px, sigma |")
    print("|---|---|---|---|---|---|---|---|")
    for name, make in (*rendered(options.views, options.seed), *cases()):
        if not any(part in name for part in options.only.split(",")):
            continue
        made = make()
        scores = {k: run(only_known(d, made[0]) if "case" in name else d, made) for k, d in chosen.items()}
        best = max(scores[k].recall for k in PEERS if k in scores)
        own, fast = scores[OURS], scores[FAST]
        cells = f"{own.wanted} | {best:.3f} | {own.recall:.3f} | {own.wrong} | {own.rms_px:.4f} | {own.spread:.2f}"
        error = deviation_error(own)
        cells += "" if np.isnan(error) else f" ± {error:.2f}"
        print(f"| {name} | {cells} | {fast.recall:.3f}, {fast.rms_px:.3f}, {fast.spread:.2f} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
