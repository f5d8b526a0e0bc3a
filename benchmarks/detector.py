"""Corners, recall, false alarms and time of the detector beside what else there is, on the same seeded images.

python benchmarks/detector.py --quick

Every figure of docs/detector.md is printed by this command without --quick. Peers come with the extra ``bench``; those
that are not installed are named as absent. One thread each; times are the processor's, the least of some runs, so that
other work on the machine disturbs them little.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from boxcal.target.arrays import Array

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import cv2  # noqa: E402
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from boxcal.detect.alignment.detector import DetectorSettings, detect_copies, detect_tags  # noqa: E402
from boxcal.detect.alignment.tag_patterns import family_patterns  # noqa: E402
from boxcal.target.box import make_target  # noqa: E402
from boxcal.target.camera.camera_model import CameraModel, project  # noqa: E402
from boxcal.target.render.renderer import SensorModel, encode_jpeg, render, visible_tags  # noqa: E402
from boxcal.target.tags.families import load_dictionary  # noqa: E402

Grey = NDArray[np.uint8]
Found = tuple[NDArray[np.int64], Array, Array | None]
"""Ids (N,), corners (N, 4, 2) px, covariances (N, 4, 2, 2) px^2 if the detector gives any."""
Detector = Callable[[Grey], Found]
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
TARGET = make_target()
GATE_PX = 3.0
"""A corner that is further off is wrong, not inaccurate."""
TURNS = 6
"""Turns of the detectors on a picture; the least time of each counts."""
OURS, FAST = "boxcal accurate", "boxcal fast"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One picture with its truth: ids that ought to be found, and where every tag's corners are."""

    image: Grey
    wanted: NDArray[np.int64]
    uv_px: Array
    width_px: Array
    covered: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


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
        """Share of the wanted tags that were found."""
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


# --- scenes ---------------------------------------------------------------------------------------------------------


def pose(rng: np.random.Generator, near: float, far: float) -> tuple[Array, Array]:
    """Return a camera's T_cam_box at a random distance from a face, 0 to 60 deg off its normal, and that normal."""
    distance, angle, turn = rng.uniform(near, far), np.deg2rad(rng.uniform(0, 60)), rng.uniform(0, 2 * np.pi)
    T_box_face = TARGET.box.T_box_face(int(rng.integers(4)))
    way = np.array([np.sin(angle) * np.cos(turn), abs(np.sin(angle) * np.sin(turn)), np.cos(angle)])
    centre = T_box_face[:3, :3] @ (way * distance) + T_box_face[:3, 3]
    aim = T_box_face[:3, 3] + T_box_face[:3, :3] @ np.array([*rng.uniform(-0.05, 0.05, 2), 0])
    z = (aim - centre) / np.linalg.norm(aim - centre)
    x = np.cross(z, (0, 0, 1.0))
    x /= np.linalg.norm(x)
    roll = rng.uniform(-0.26, 0.26)
    R = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3] = R @ np.stack([x, np.cross(z, x), z])
    T[:3, 3] = -T[:3, :3] @ centre
    return T, centre


def width_px(corners: Array) -> Array:
    """Return the narrower way across tags (N, 4, 2), (N,) px."""
    a, b = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    side = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    return np.asarray(0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / np.maximum(side, 1e-9))


def scenes(
    views: int,
    *,
    seed: int = 1,
    scale: float = 1.0,
    focal: float = 800.0,
    distances: tuple[float, float] = (0.4, 1.2),
    widths: tuple[float, float] = (16.0, 1e9),
    sensor: SensorModel = SensorModel(noise=2, psf_px=0.6),  # noqa: B008 - frozen
    kr: float = -0.1,
    change: Callable[[Scene, np.random.Generator], Scene] | None = None,
) -> list[Scene]:
    """Return rendered views of the default box; wanted are tags on faces seen within 60 deg, of those widths."""
    size = (round(640 * scale), round(480 * scale)) if scale < 4 else (3840, 2160)
    rng = np.random.default_rng(seed)
    made = []
    while len(made) < views:
        camera = CameraModel(
            fu=focal * scale, fv=focal * scale, cu=size[0] / 2 + 9 * scale, cv=size[1] / 2 - 7 * scale, kr=kr
        )
        T_cam_box, centre = pose(rng, *distances)
        uv = project(camera, TARGET.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
        seen = visible_tags(TARGET, camera, T_cam_box, size, 2.0)
        width = width_px(uv)
        normals = np.stack([TARGET.box.T_box_face(int(f))[:3, 2] for f in TARGET.tag_faces[seen]])
        ray = centre - TARGET.tag_corners[seen].mean(axis=1)
        steep = np.einsum("ni,ni->n", normals, ray / np.linalg.norm(ray, axis=1, keepdims=True)) < 0.5
        wanted = seen[~steep & (width[seen] >= widths[0] * scale) & (width[seen] < widths[1] * scale)]
        if len(wanted) == 0:
            continue
        image = render(TARGET, camera, T_cam_box, size, sensor, rng)
        scene = Scene(image=image, wanted=wanted, uv_px=uv, width_px=width)
        made.append(change(scene, rng) if change else scene)
    return made


def jpeg(scene: Scene, _: np.random.Generator) -> Scene:
    data = np.frombuffer(encode_jpeg(scene.image, 85), np.uint8)
    return replace(scene, image=np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8))


def cover_half(scene: Scene, rng: np.random.Generator) -> Scene:
    """Hide half of what is wanted behind a textured board; tags that it touches are no longer wanted."""
    corners = scene.uv_px[scene.wanted]
    edge = float(np.median(corners[..., 0]))
    image = scene.image.copy()
    board = cv2.GaussianBlur(rng.uniform(0, 255, image.shape).astype(np.float32), (0, 0), 2)
    board = np.clip(128 + 6 * (board - 128), 0, 255)
    column = int(edge)
    image[:, column:] = board[:, column:].astype(np.uint8)
    reach = corners[..., 0].max(axis=1) > column - 3
    hidden = np.flatnonzero(scene.uv_px[..., 0].min(axis=1) > column)
    return replace(scene, image=image, wanted=scene.wanted[~reach], covered=hidden)


def tagless(count: int, seed: int = 7) -> list[Grey]:
    """Return pictures without a tag of the target: clutter, text, grids, and tags of other families or ids."""
    rng = np.random.default_rng(seed)
    families = ["DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9"]
    families += ["DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11", "DICT_ARUCO_ORIGINAL"]
    makers = [_clutter, _text, _grid, lambda r: _others(r, families[int(r.integers(len(families)))])]
    images = []
    for k in range(count):
        image = makers[k % len(makers)](rng).astype(np.float32)
        image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0, 2, image.shape)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return images


def _clutter(rng: np.random.Generator) -> Array:
    image = np.full((480, 640), float(rng.uniform(60, 220)))
    for _ in range(int(rng.integers(80, 400))):
        points = rng.uniform(0, (640, 480), 2) + rng.normal(0, rng.uniform(4, 60), (int(rng.integers(3, 7)), 2))
        cv2.fillPoly(image, [points.astype(np.int32)], float(rng.uniform(0, 255)))
    return image


def _text(rng: np.random.Generator) -> Array:
    image = np.full((480, 640), 235, np.uint8)
    letters = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789#@%&[]"))
    for row in range(10, 480, int(rng.integers(9, 40))):
        line = "".join(rng.choice(letters, 60))
        size = float(rng.uniform(0.25, 1.5))
        cv2.putText(
            image, line, (4, row), int(rng.integers(0, 6)), size, float(rng.uniform(0, 90)), int(rng.integers(1, 4))
        )
    return image.astype(np.float64)


def _grid(rng: np.random.Generator) -> Array:
    """Return a warped board of framed squares with random modules between."""
    module = int(rng.integers(2, 7))
    cells = np.kron(
        rng.random((480 // module + 1, 640 // module + 1)) < rng.uniform(0.3, 0.7), np.ones((module, module))
    )
    image = np.where(cells[:480, :640] > 0, 20.0, 230.0)
    pitch = module * int(rng.integers(8, 12))
    for y in range(0, 480, pitch):
        for x in range(0, 640, pitch):
            cv2.rectangle(image, (x, y), (x + pitch - 1, y + pitch - 1), 235.0, module)
            cv2.rectangle(
                image, (x + module, y + module), (x + pitch - 1 - module, y + pitch - 1 - module), 15.0, module
            )
    corners = np.array([[0, 0], [640, 0], [640, 480], [0, 480]], np.float32)
    H = cv2.getPerspectiveTransform(corners, (corners + rng.uniform(-90, 90, (4, 2))).astype(np.float32))
    return np.asarray(cv2.warpPerspective(image, H, (640, 480), borderValue=128.0), dtype=np.float64)


def _others(rng: np.random.Generator, family: str) -> Array:
    image = np.full((480, 640), 225.0)
    dictionary = load_dictionary(family)
    first = TARGET.tag_ids.size if family == TARGET.box.dictionary else 0
    side = int(rng.integers(16, 70))
    for y in range(8, 480 - side - 8, side + max(6, side // 4)):
        for x in range(8, 640 - side - 8, side + max(6, side // 4)):
            tag = int(rng.integers(first, dictionary.bytesList.shape[0]))
            image[y : y + side, x : x + side] = cv2.aruco.generateImageMarker(dictionary, tag, side)
    return image


# --- detectors ------------------------------------------------------------------------------------------------------


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


def ours(settings: DetectorSettings) -> Detector:
    def detect(image: Grey) -> Found:
        tags = detect_tags(image, TARGET, settings)
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


# --- measuring ------------------------------------------------------------------------------------------------------


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
    for scale, name in ((2.0, "1280x960"), (6.0, "3840x2160")):
        larger(chosen, few if scale < 4 else max(2, views // 12), scale, name)
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


def larger(chosen: dict[str, Detector], views: int, scale: float, name: str) -> None:
    made = scenes(views, seed=2, scale=scale)
    print(f"{name}, {views} views, {sum(len(s.wanted) for s in made)} visible tags")
    some = {k: v for k, v in chosen.items() if k in {"OpenCV, no refinement", "pyapriltags", OURS, FAST}}
    table(some, made, 2)


def speed(chosen: dict[str, Detector], views: int) -> None:
    """Time on sRGB JPEG, the detectors taking turns on every picture, so that what else runs slows all alike."""
    camera = SensorModel(noise=2, psf_px=0.6, srgb=True)
    some = {k: chosen[k] for k in ("OpenCV, no refinement", FAST, OURS)}
    print("time on sRGB JPEG\n| picture | OpenCV ms | fast | accurate | recall | rms px | sigma |")
    print("|---|---|---|---|---|---|---|")
    for scale, count in ((1.0, views), (2.0, views // 2), (3.0, views // 3), (6.0, views // 4)):
        made = scenes(max(2, count), seed=31, scale=scale, sensor=camera, change=jpeg)
        least = dict.fromkeys(some, 0.0)
        for scene in made:
            times: dict[str, list[float]] = {name: [] for name in some}
            for _ in range(TURNS):
                for name, detect in some.items():
                    start = time.process_time()
                    detect(scene.image)
                    times[name].append(time.process_time() - start)
            for name in some:
                least[name] += min(times[name]) / len(made)
        score, base = run(chosen[OURS], made), least["OpenCV, no refinement"]
        height, width = made[0].image.shape
        cells = " | ".join(f"{least[name] / base:.2f}" for name in (FAST, OURS))
        accuracy = f"{score.recall:.4f} | {score.rms_px:.4f} | {score.spread:.2f}"
        print(f"| {width}x{height} | {1e3 * base:.1f} | {cells} | {accuracy} |", flush=True)
    print()


def small(chosen: dict[str, Detector], views: int) -> None:
    """Recall by the narrower way across a tag."""
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


# --- pictures that no one here made ---------------------------------------------------------------------------------


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
    from boxcal.detect.log.recording import open_recording  # noqa: PLC0415

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
