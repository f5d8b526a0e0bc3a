"""Hard pictures: recall and errors beside the best peer, where light, paper, lens or sensor are unkind.

python benchmarks/hard_pictures.py

prints the table of hard pictures in docs/detector.md. Some are rendered here (several views each); those of
``shared/cases/pictures`` beside the project, each with its truth, follow where they are present. Wanted are tags wider
than 10 px on faces seen within 60 degrees (of the cases: all that the truth has); normalised errors have a deviation of
one where the covariances are right.
"""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from tag_detectors import FAST, OURS, detectors, run
from tag_scenes import TARGET, Scene, jpeg, scenes, width_px

from boxcal.target.render.renderer import SensorModel

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases" / "pictures"
PEERS = ("OpenCV SUBPIX (default)", "OpenCV, no refinement", "pyapriltags", "pupil-apriltags")
PLAIN = SensorModel(noise=2, psf_px=0.6)
LEAST_WIDTH_PX = 10.0
ASPECTS = (0.75, 0.85, 0.92, 0.98)
"""Pixels that are not square, as anamorphic sensors and resized streams have them."""
FINER = 3.0
"""How much finer pictures are rendered in which ink spreads."""


def shadow(scene: Scene, rng: np.random.Generator) -> Scene:
    """Put the darker part of a picture behind a hard edge: a third of the light, the edge a pixel wide."""
    height, width = scene.image.shape
    y, x = np.mgrid[:height, :width]
    angle = rng.uniform(0.3, 1.2)
    middle = scene.uv_px[scene.wanted].mean(axis=(0, 1))
    side = (x - middle[0]) * np.cos(angle) + (y - middle[1]) * np.sin(angle)
    light = 0.33 + 0.67 / (1 + np.exp(-np.clip(side / 0.7, -50, 50)))
    return replace(scene, image=np.rint(scene.image * light).astype(np.uint8))


def glare(scene: Scene, rng: np.random.Generator) -> Scene:
    """Add a saturating highlight, 60 px wide, near the middle of the tags."""
    height, width = scene.image.shape
    y, x = np.mgrid[:height, :width]
    middle = scene.uv_px[scene.wanted].mean(axis=(0, 1)) + rng.uniform(-30, 30, 2)
    spot = 260 * np.exp(-0.5 * ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / 25.0**2)
    return replace(scene, image=np.clip(np.rint(scene.image + spot), 0, 255).astype(np.uint8))


def interlaced(scene: Scene, _: np.random.Generator) -> Scene:
    """Take the two fields of a picture half a frame apart, the box 2 px further right in the second; truth midway."""
    fields = [cv2.warpAffine(scene.image, np.array([[1.0, 0, side], [0, 1, 0]]), None) for side in (-1.0, 1.0)]
    image = fields[0].copy()
    image[1::2] = fields[1][1::2]
    return replace(scene, image=image)


def bled(views: int, seed: int) -> list[Scene]:
    """Return views of a box whose ink spread by a tenth of a pixel into the paper, corners where they were meant."""
    fine = scenes(views, seed=seed, scale=FINER, sensor=SensorModel(psf_px=0.6 * FINER))
    rng, made = np.random.default_rng(seed), []
    for scene in fine:
        spread = 0.7 * scene.image + 0.3 * cv2.erode(scene.image, np.ones((3, 3), np.uint8))
        coarse = cv2.resize(spread, None, fx=1 / FINER, fy=1 / FINER, interpolation=cv2.INTER_AREA)
        image = np.clip(np.rint(coarse + 2 * rng.normal(size=coarse.shape)), 0, 255).astype(np.uint8)
        uv = (scene.uv_px + 0.5) / FINER - 0.5
        made.append(replace(scene, image=image, uv_px=uv, width_px=scene.width_px / FINER))
    return made


def rendered(views: int) -> Iterator[tuple[str, list[Scene]]]:
    """Yield named sets of rendered views."""
    yield "hard shadow", scenes(views, seed=141, sensor=PLAIN, change=shadow)
    yield "highlight", scenes(views, seed=142, sensor=PLAIN, change=glare)
    yield "motion 2 px", scenes(views, seed=143, sensor=replace(PLAIN, motion_blur_px=2.0, motion_angle=0.6))
    yield "motion 3 px", scenes(views, seed=144, sensor=replace(PLAIN, motion_blur_px=3.0, motion_angle=0.6))
    yield "no blur", scenes(views, seed=145, sensor=replace(PLAIN, psf_px=0.0))
    yield "ink bleed", bled(views, 147)
    yield "interlaced, 2 px", scenes(views, seed=149, sensor=PLAIN, change=interlaced)
    for aspect in ASPECTS:
        yield f"fv/fu {aspect:g}", scenes(views, seed=148, sensor=PLAIN, aspect=aspect)
    yield "sRGB JPEG", scenes(views, seed=146, sensor=replace(PLAIN, srgb=True), change=jpeg)


def cases() -> Iterator[tuple[str, list[Scene]]]:
    """Yield the pictures of ``shared/cases``; none where they are absent."""
    for truth in sorted(CASES.glob("*.truth.json")):
        name = truth.name.removesuffix(".truth.json")
        picture = next(p for p in sorted(CASES.glob(f"{name}.*")) if p.suffix in {".png", ".jpg"})
        image = np.asarray(cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
        yield f"case {name}", [case(image, json.loads(truth.read_text()))]


def case(image: np.ndarray, corners: dict[str, list[list[float]]]) -> Scene:
    """Return a picture with the corners of the tags that its truth has; nothing is known of others."""
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


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=6, help="rendered views of each set (6)")
    options = parser.parse_args(argv)
    cv2.setNumThreads(1)
    chosen = detectors()[0]
    print("| picture | tags | best peer's recall | recall | wrong | rms px | sigma | fast: recall, rms px, sigma |")
    print("|---|---|---|---|---|---|---|---|")
    for name, made in (*rendered(options.views), *cases()):
        scores = {k: run(only_known(d, made[0]) if "case" in name else d, made) for k, d in chosen.items()}
        best = max(scores[k].recall for k in PEERS if k in scores)
        own, fast = scores[OURS], scores[FAST]
        cells = f"{own.wanted} | {best:.3f} | {own.recall:.3f} | {own.wrong} | {own.rms_px:.4f} | {own.spread:.2f}"
        print(f"| {name} | {cells} | {fast.recall:.3f}, {fast.rms_px:.3f}, {fast.spread:.2f} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
