"""The command ``detect-tags``: images in, the box's tags out - as text, as JSON, and drawn to be looked at."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from boxcal.command_line import CommandParser
from boxcal.detect.errors import DetectError
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_atomically

if TYPE_CHECKING:
    from boxcal.detect.alignment.detection import DetectorOutput
    from boxcal.target.box import Target

SCHEMA = 1
MAX_FILE_BYTES = 1 << 29


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``detect-tags``; return 0, or 1 if an image could not be read or written (argparse exits with 2)."""
    args = _parser().parse_args(argv)
    try:
        target = _target(args.target)
    except TargetError as error:
        print(f"detect-tags: {error}", file=sys.stderr)
        return 1
    if not args.fast:
        from boxcal.detect.alignment.compilation import prepare

        prepare(lambda line: print(f"detect-tags: {line}", file=sys.stderr))
    documents: list[dict[str, Any]] = []
    failed = False
    to_stdout = args.json == "-"
    for number, name in enumerate(args.images):
        try:
            document, line = _one(Path(name), target, args, number)
        except (DetectError, TargetError) as error:
            print(f"detect-tags: {error}", file=sys.stderr)
            failed = True
            continue
        documents.append(document)
        print(line, file=sys.stderr if to_stdout else sys.stdout)
    if args.json:
        failed |= not _write_json(args.json, target, documents)
    return int(failed)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        "detect-tags",
        description="example:\n"
        "  detect-tags photo.jpg                      the default box: how many tags, how sharp, how sure\n"
        "  detect-tags *.png --target box/target.json --draw seen --json corners.json\n\n"
        "Find the tags of a landmark box in pictures and say where their corners are. Look at what --draw writes\n"
        "before you trust a calibration.",
    )
    parser.add_argument("images", nargs="+", metavar="IMAGE", help="a picture: JPEG, PNG, TIFF ... of 8 or 16 bits")
    parser.add_argument("--target", metavar="FILE", help="target.json of the box (default: the default box)")
    parser.add_argument("--draw", metavar="FOLDER", help="write each picture with what was found drawn into it")
    parser.add_argument("--json", metavar="FILE", help="write ids, corners and covariances; - for standard output")
    parser.add_argument("--fast", action="store_true", help="preview: only tags that are easily seen, rougher corners")
    parser.add_argument(
        "--tone",
        choices=("auto", "linear", "srgb"),
        default="auto",
        help="the camera response function (default: auto, estimated from the tags)",
    )
    return parser


def _target(name: str | None) -> "Target":
    from boxcal.target.box import make_target
    from boxcal.target.files.target_json import load_target

    return make_target() if name is None else load_target(Path(name))


def _one(path: Path, target: "Target", args: argparse.Namespace, number: int) -> tuple[dict[str, Any], str]:
    """Return what an image shows, as JSON and as a line of text; draw it if that is asked for."""
    from boxcal.detect.alignment.detection import DetectorSettings
    from boxcal.detect.alignment.detector import detect_tags

    image = _read(path)
    try:
        tags = detect_tags(image, target, DetectorSettings(response=args.tone, fast=args.fast))
    except DetectError as error:
        raise DetectError(f"{path.name}: {error}") from error
    line = f"{path.name}: {_summary(tags, target)}{_sensor(image)}"
    if args.draw:
        from boxcal.detect.image.annotate import drawn_png

        out = Path(args.draw) / f"{number:04d}-{path.stem}.png"
        try:
            write_atomically(out, drawn_png(image, tags))
        except OSError as error:
            raise DetectError(f"{out}: cannot be written ({error.strerror or error}); name another folder") from error
        line += f"; drawn in {out}"
    return _document(path, image, tags), line


def _read(path: Path) -> Any:
    import cv2
    import numpy as np

    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise DetectError(f"{path.name}: larger than {MAX_FILE_BYTES} bytes; not read")
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise DetectError(f"{path.name}: cannot be read ({error.strerror or error}); name a picture") from error
    image = None
    if data.size:
        try:
            image = cv2.imdecode(data, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
        except cv2.error as error:
            raise DetectError(f"{path.name}: cannot be decoded ({error.err}); name a smaller picture") from error
    if image is None:
        raise DetectError(f"{path.name}: not a picture that OpenCV can decode; name a JPEG, PNG or TIFF file")
    return image


def _summary(tags: "DetectorOutput", target: "Target") -> str:
    import numpy as np

    if len(tags.ids) == 0:
        return "no tags of the box"
    faces, counts = np.unique(target.tag_faces[[target.row_of(int(i)) for i in tags.ids]], return_counts=True)
    by_face = ", ".join(f"{count} on face {face}" for face, count in zip(faces, counts, strict=True))
    noun = "tag" if len(tags.ids) == 1 else "tags"
    sigma = np.sqrt(np.median(np.trace(tags.cov_px2, axis1=2, axis2=3)) / 2)
    figures = f"corners to {sigma:.3f} px"
    if np.isfinite(tags.blur_px).all():
        figures += f", blur {np.median(tags.blur_px):.2f} px, {tags.response} response curve"
    if tags.contradicting_faces:
        figures += "; " + other_box(tags.contradicting_faces)
    return f"{len(tags.ids)} {noun} ({by_face}); {figures}"


def _sensor(image: Any) -> str:
    """Return what the image is that it does not say: a colour mosaic, or interlaced; empty if it is neither."""
    from boxcal.detect.image.bayer import alternation, unnamed_mosaic

    if image.ndim != 2 or min(image.shape) < 16:
        return ""
    if unnamed_mosaic(image):
        return "; a raw colour mosaic sent as grey, read as one (name its encoding bayer_...)"
    if alternation(image) == (False, True):
        return "; rows alternate: interlaced while something moved, both fields averaged (the time is midway)"
    return ""


def other_box(faces: Sequence[int]) -> str:
    """Return a phrase about faces that are seen where the box cannot have them."""
    noun, verb = ("face", "is") if len(faces) == 1 else ("faces", "are")
    which = ", ".join(map(str, faces))
    return f"{noun} {which} {verb} seen where this box cannot have them (a second box, or a print on the wall?)"


def _document(path: Path, image: Any, tags: "DetectorOutput") -> dict[str, Any]:
    import numpy as np

    found = [
        {
            "id": int(tag),
            "corners_px": np.round(corners, 5).tolist(),
            "cov_px2": [[[float(f"{c:.4g}") for c in row] for row in corner] for corner in cov],
            "correlation": round(float(correlation), 5) if np.isfinite(correlation) else None,
        }
        for tag, corners, cov, correlation in zip(
            tags.ids, tags.corners_px, tags.cov_px2, tags.correlation, strict=True
        )
    ]
    return {
        "image": path.name,
        "width_px": int(image.shape[1]),
        "height_px": int(image.shape[0]),
        "tone": tags.response,
        "tags": found,
    }


def _write_json(name: str, target: "Target", documents: list[dict[str, Any]]) -> bool:
    from boxcal.target.files.target_json import target_sha256

    text = json.dumps(
        {
            "schema": SCHEMA,
            "pixels": "(0, 0) is the centre of the top-left pixel; u to the right, v down",
            "corner_order": "top-left, top-right, bottom-right, bottom-left of the tag as drawn",
            "target_sha256": target_sha256(target),
            "images": documents,
        },
        indent=1,
        allow_nan=False,
    )
    if name == "-":
        print(text)
        return True
    try:
        write_atomically(Path(name), (text + "\n").encode())
    except OSError as error:
        print(f"detect-tags: {name}: cannot be written ({error.strerror or error})", file=sys.stderr)
        return False
    return True
