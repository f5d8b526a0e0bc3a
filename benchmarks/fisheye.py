"""Corners and recall of the detector on tags that fisheye lenses curve, beside what else there is.

python benchmarks/fisheye.py

Views are made ray by ray by ``tests/detect_align/fisheye_views.py``; this command prints the fisheye table of
docs/detector.md. Wanted are tags wholly in view, wider than 10 px, on faces seen within 60 degrees.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tag_detectors import OURS, detectors, run
from tag_scenes import Scene, width_px

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "detect_align"))

from aligned_views import pose
from fisheye_views import aimed, fisheye, fisheye_truth, fisheye_view

LENSES = ((0.0, 0.0, 0.0, 0.0), (-0.02, -0.004, 0.001, 0.0), (0.03, -0.01, 0.001, 0.0))
"""k1 to k4 as OpenCV's fisheye model has them."""
PLACES = {"centre": (0.5, 0.5), "side": (0.14, 0.55), "corner": (0.82, 0.22)}
"""Where the box's middle is seen, fractions of the image."""
VIEWS = {
    640: ((0.345, 5, 15), (0.395, 40, 20), (0.475, 20, 10)),
    1280: ((0.395, 5, 15), (0.525, 40, 20), (0.675, 20, 10)),
}
"""Distance to the box's middle m, azimuth and elevation deg."""
PEERS = ("OpenCV SUBPIX (default)", "pyapriltags", OURS)


def scenes(size: tuple[int, int], fov_deg: float, place: str) -> list[Scene]:
    """Return views through three lenses, each from another place."""
    made = []
    for k, (distance, azimuth_deg, elevation_deg) in zip(LENSES, VIEWS[size[0]], strict=True):
        camera = fisheye(fov_deg, size, k)
        T = pose(azimuth_deg, distance=distance, elevation_deg=elevation_deg)
        T = aimed(T, camera, np.array(PLACES[place]) * size)
        uv, seen = fisheye_truth(T, camera)
        width = width_px(uv)
        image = fisheye_view(T, camera, seed=int(fov_deg + azimuth_deg))
        made.append(Scene(image=image, wanted=seen[width[seen] >= 10], uv_px=uv, width_px=width))
    return made


def main(argv: Sequence[str] | None = None) -> int:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args(argv)
    chosen = {name: detect for name, detect in detectors()[0].items() if name in PEERS}
    print("| size | field of view | detector | tags | recall | wrong | rms px | sigma |\n" + "|---" * 8 + "|")
    for size in ((640, 480), (1280, 960)):
        for fov_deg in (90, 120, 150, 180, 210):
            made = [scene for place in PLACES for scene in scenes(size, fov_deg, place)]
            for name, detect in chosen.items():
                score = run(detect, made)
                sigma = "" if np.isnan(score.spread) else f"{score.spread:.2f}"
                cells = f"{score.wanted} | {score.recall:.3f} | {score.wrong} | {score.rms_px:.4f} | {sigma}"
                print(f"| {size[0]}x{size[1]} | {fov_deg} | {name} | {cells} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
