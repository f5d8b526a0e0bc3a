"""Corners, recall, false alarms and time of the detector beside what else there is, on the same seeded images.

python benchmarks/detector.py --quick

Every number of docs/detector.md is printed by this command without --quick. Peers come with the extra ``bench``; those
that are not installed are named as absent. One thread each; times are the processor's, the least of some runs, so that
other work on the machine disturbs them little.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tag_scenes import TARGET, Scene, cover_half, jpeg, scenes, tagless, width_px  # isort: skip - one thread first
from tag_detectors import FAST, OURS, Detector, detectors, ours, run  # isort: skip

import cv2
import numpy as np

from boxcal.detect.alignment.detection import DetectorSettings
from boxcal.detect.alignment.detector import detect_copies, detect_tags
from boxcal.detect.alignment.expected_tags import ExpectedTags
from boxcal.detect.alignment.tag_patterns import family_patterns
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.render.renderer import SensorModel, visible_tags
from boxcal.target.tags.families import modules_per_side

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
EXPECTED = "boxcal, tags expected"
ULTRA_HD = (3840, 2160)
TURNS = 6
"""Turns of the detectors on an image; the least time of each counts."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few views of each set")
    parser.add_argument("--views", type=int, help="views of the VGA set (36)")
    parser.add_argument("--time", action="store_true", help="only the time on sRGB JPEG")
    options = parser.parse_args(argv)
    views = options.views or (6 if options.quick else 36)
    few = max(3, views // 3)
    cv2.setNumThreads(1)
    chosen, absent = detectors()
    print(f"absent: {', '.join(absent)}\n")
    speed(chosen, few)
    if options.time:
        return 0
    accuracy(chosen, views)
    larger(chosen, few, 2.0, (1280, 960))
    larger(chosen, max(2, views // 12), 6.0, ULTRA_HD)
    small(chosen, few)
    alarms({k: chosen[k] for k in chosen if k in {OURS, FAST, "pyapriltags"}}, 40 if options.quick else 320)
    conditions(chosen, few)
    real(chosen)
    return 0


def accuracy(chosen: dict[str, Detector], views: int) -> None:
    made = scenes(views)
    total = sum(len(s.wanted) for s in made)
    print(f"640x480, {views} views at 0.4 to 1.2 m, 0 to 60 deg, {total} visible tags, noise 2, blur 0.6")
    table(chosen, made, 5)


def table(chosen: dict[str, Detector], made: Sequence[Scene], repeat: int) -> None:
    print("| detector | recall | wrong | rms px | sigma | ms | time |\n|---|---|---|---|---|---|---|")
    base = float("nan")
    for name, detect in chosen.items():
        detect(made[0].image)
        score = run(detect, made, repeat)
        ms = 1e3 * float(np.mean(score.seconds))
        base = ms if name == "OpenCV, no refinement" else base
        sigma = "" if np.isnan(score.spread) else f"{score.spread:.2f}"
        cells = f"{score.recall:.4f} | {score.wrong} | {score.rms_px:.4f} | {sigma}"
        print(f"| {name} | {cells} | {ms:.1f} | {ms / base:.2f} |", flush=True)
    print()


def larger(chosen: dict[str, Detector], views: int, scale: float, size: tuple[int, int]) -> None:
    made = scenes(views, seed=2, scale=scale, size=size)
    print(f"{size[0]}x{size[1]}, {views} views, {sum(len(s.wanted) for s in made)} visible tags")
    some = {k: v for k, v in chosen.items() if k in {"OpenCV, no refinement", "pyapriltags", OURS, FAST}}
    table(some, made, 2)


def speed(chosen: dict[str, Detector], views: int) -> None:
    """Time on sRGB JPEG, the detectors taking turns on every image, so that other load slows all equally."""
    camera = SensorModel(noise=2, psf_px=0.6, srgb=True)
    some = {k: chosen[k] for k in ("OpenCV, no refinement", FAST, OURS)}
    print("time on sRGB JPEG\n| picture | OpenCV ms | fast | accurate | expected | recall | rms px | sigma |")
    print("|---|---|---|---|---|---|---|---|")
    for scale, size, count in (
        (1.0, (640, 480), views),
        (2.0, (1280, 960), views // 2),
        (3.0, (1920, 1080), views // 3),
        (3.0, (1920, 1440), views // 3),
        (6.0, ULTRA_HD, views // 4),
    ):
        made = scenes(max(2, count), seed=31, scale=scale, size=size, sensor=camera, change=jpeg)
        least = dict.fromkeys([*some, EXPECTED], 0.0)
        for scene in made:
            times: dict[str, list[float]] = {name: [] for name in least}
            turns = some | {EXPECTED: expecting(scene)}
            for _ in range(TURNS):
                for name, detect in turns.items():
                    start = time.process_time()
                    detect(scene.image)
                    times[name].append(time.process_time() - start)
            for name in least:
                least[name] += min(times[name]) / len(made)
        score, base = run(chosen[OURS], made), least["OpenCV, no refinement"]
        height, width = made[0].image.shape
        cells = " | ".join(f"{least[name] / base:.2f}" for name in (FAST, OURS, EXPECTED))
        accuracy = f"{score.recall:.4f} | {score.rms_px:.4f} | {score.spread:.2f}"
        print(f"| {width}x{height} | {1e3 * base:.1f} | {cells} | {accuracy} |", flush=True)
    print()


def expecting(scene: Scene) -> Detector:
    """Return a detector that knows the camera, and the wanted tags' places but for half a module's error."""
    corners = scene.uv_px[scene.wanted]
    half_module = float(np.median(scene.width_px[scene.wanted])) / modules_per_side(TARGET.box.dictionary) / 2
    expected = ExpectedTags(ids=scene.wanted, corners_px=corners + half_module * np.array([0.8, 0.6]))
    return ours(DetectorSettings(), camera=detect_tags(scene.image, TARGET).camera, expected=expected)


def small(chosen: dict[str, Detector], views: int) -> None:
    """Recall by the shorter distance across a tag."""
    bins = ((8, 10), (10, 12), (12, 14), (14, 16))
    sets = {b: scenes(views, seed=3 + b[0], focal=420.0, distances=(0.5, 1.3), widths=b, kr=0.0) for b in bins}
    print("small tags: recall by width, px\n| detector | " + " | ".join(f"{a}-{b}" for a, b in bins) + " | wrong |")
    print("|---|" + "---|" * (len(bins) + 1))
    for name, detect in chosen.items():
        scores = [run(detect, sets[b]) for b in bins]
        cells = " | ".join(f"{s.recall:.3f}" for s in scores)
        print(f"| {name} | {cells} | {sum(s.wrong for s in scores)} |", flush=True)
    print(f"tags: {', '.join(str(sum(len(s.wanted) for s in sets[b])) for b in bins)}\n")


def alarms(chosen: dict[str, Detector], count: int) -> None:
    images = tagless(count)
    print(f"{count} pictures without a tag of the target: tags found")
    for name, detect in chosen.items():
        found = sum(int(np.sum(detect(image)[0] < TARGET.tag_ids.size)) for image in images)
        print(f"| {name} | {found} |", flush=True)
    print()


def conditions(chosen: dict[str, Detector], views: int) -> None:
    plain = SensorModel(noise=2, psf_px=0.6)
    sets = {
        "JPEG 85": scenes(views, seed=21, change=jpeg),
        "noise 6": scenes(views, seed=22, sensor=replace(plain, noise=6)),
        "blur 1.2": scenes(views, seed=23, sensor=replace(plain, psf_px=1.2)),
        "motion 1 px": scenes(views, seed=24, sensor=replace(plain, motion_blur_px=1.0, motion_angle=0.6)),
        "half covered": scenes(views, seed=25, change=cover_half),
        "vignetting 0.8": scenes(views, seed=26, sensor=replace(plain, vignetting=0.8)),
        "sRGB": scenes(views, seed=27, sensor=replace(plain, srgb=True)),
        "no blur": scenes(views, seed=28, sensor=replace(plain, psf_px=0.0)),
    }
    some = {k: v for k, v in chosen.items() if k in {"OpenCV SUBPIX (default)", "pyapriltags", OURS}}
    print("| condition | detector | recall | wrong | rms px | sigma | shrink px |\n|---|---|---|---|---|---|---|")
    for name, made in sets.items():
        for detector, detect in some.items():
            score = run(detect, made)
            sigma = "" if np.isnan(score.spread) else f"{score.spread:.2f}"
            shrink = float(np.concatenate(score.shrink).mean())
            cells = f"{score.recall:.4f} | {score.wrong} | {score.rms_px:.4f} | {sigma} | {shrink:+.4f}"
            print(f"| {name} | {detector} | {cells} |", flush=True)
    print()


def real(chosen: dict[str, Detector]) -> None:
    if not DATA.is_dir():
        print("no shared data beside the project: photographs and path-traced logs left out")
        return
    for log in sorted((DATA / "fleet").glob("*.mcap")):
        made = logged(log)
        print(f"{log.name}: {len(made)} frames, {sum(len(s.wanted) for s in made)} visible tags")
        table({k: v for k, v in chosen.items() if k != FAST}, made, 1)
    patterns = family_patterns("DICT_APRILTAG_36h11", np.arange(1))
    for path in sorted((DATA / "photos").glob("*.jpg")):
        photograph(path, detect_copies(np.asarray(cv2.imread(str(path))), patterns).corners_px)


def logged(log: Path) -> list[Scene]:
    """Return the first frame of each stop of a path-traced log, with the truth from its file."""
    from boxcal.detect.log.open_recording import open_recording  # noqa: PLC0415

    truth = json.loads(log.with_suffix(".truth.json").read_text())
    figures = truth["camera"]
    camera = CameraModel(**{k: figures[k] for k in ("fu", "fv", "cu", "cv", "kr")})
    size = (figures["width"], figures["height"])
    recording = open_recording(log)
    made = []
    for stop in truth["stops"]:
        first, last = (round(truth["t0_ns"] + stop[k] * 1e9) for k in ("t_start", "t_end"))
        frames = recording.frames_between(first + 100_000_000, last - 100_000_000)[:1]
        T_cam_box = np.linalg.inv(np.array(stop["T_world_camera"]))
        uv = project(camera, TARGET.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        seen = visible_tags(TARGET, camera, T_cam_box, size, 1.0)
        width = width_px(uv)
        for _, image in recording.read_frames(frames):
            made.append(Scene(image=image, wanted=seen[width[seen] >= 10], uv_px=uv, width_px=width))
    return made


def photograph(path: Path, corners: Array) -> None:
    """Compare with the reference file's corners, whose origin is the corner of the first pixel."""
    lines = path.with_suffix(".txt").read_text().split("\n")
    numbers = [line.replace("(", " ").replace(")", " ").replace(",", " ").split()[1:] for line in lines if line.strip()]
    reference = np.array(numbers, dtype=np.float64).reshape(-1, 4, 2) - 0.5
    orders = [[(s + k * d) % 4 for k in range(4)] for s in range(4) for d in (1, -1)]
    centres = np.linalg.norm(corners.mean(axis=1)[None] - reference.mean(axis=1)[:, None], axis=2)
    nearest = centres.argmin(axis=1)
    found = centres.min(axis=1) < 2
    off = np.array(
        [min(np.abs(corners[k][o] - r).max() for o in orders) for k, r in zip(nearest, reference, strict=True)]
    )
    middle, most, worst = np.quantile(off[found], (0.5, 0.9, 1.0))
    print(f"{path.name}: {found.sum()} of {len(found)} tags found, {len(corners)} in all;", end=" ")
    print(f"largest difference of a tag's corners: median {middle:.2f}, 90 % {most:.2f}, most {worst:.2f} px")


if __name__ == "__main__":
    raise SystemExit(main())
