"""The command ``make-target``: a box's figures in, its landmark table and printable sheets out."""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from target.box import Box, Target, make_target
from target.errors import TargetError
from target.files import write_atomically
from target.landmarks import load_target, target_bytes
from target.paper.papers import PAPERS, mm
from target.sheets import sheets_pdf

TARGET_NAME = "target.json"

_DEFAULT: dict[str, Any] = {f.name: f.default for f in fields(Box)}
_LENGTHS = {
    "width": "along x",
    "depth": "along y",
    "height": "along z",
    "tag_size": "outer edge of a tag's black border",
    "pitch": "from one tag's centre to the next, both ways",
}
_COUNTS = {
    "columns": "tags across a face",
    "rows": "tags down a face",
    "first_id": "id of face 0's top left tag; ids run on by columns, rows and faces",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``make-target``; return 0 if all was written, 1 if something could not be made (argparse exits with 2)."""
    args = _parser().parse_args(argv)
    folder = Path(args.folder)
    try:
        target = make_target(_box(args))
        papers = ["a4", "letter"] if args.paper == "both" else [args.paper]
        sheets = {f"box-{paper}.pdf": sheets_pdf(target, PAPERS[paper]) for paper in papers}
        _refuse_other_target(folder, target)
        _write_together(folder, {TARGET_NAME: target_bytes(target)} | sheets)
    except TargetError as error:
        print(f"make-target: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(
            f"make-target: {folder}: cannot be written ({error.strerror or error}); name another FOLDER",
            file=sys.stderr,
        )
        return 1
    print(f"{folder / TARGET_NAME}: {target.tag_ids.size} tags, ids {target.tag_ids[0]} to {target.tag_ids[-1]}")
    for paper, name in zip(papers, sheets, strict=True):
        print(f"{folder / name}: 4 pages of {PAPERS[paper].name}, one a face")
    print('Next: print a PDF at 100 % (no "fit to page"), then measure its bars: both must be 100 mm long.')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="make-target",
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="example:\n"
        "  make-target box            the default box: box/target.json, box/box-a4.pdf, box/box-letter.pdf\n"
        "  make-target small --width 120 --depth 120 --height 120 --columns 3 --rows 3 --paper a4\n\n"
        "Make the landmark box that robots are calibrated with: printable sheets of its four faces in exact size,\n"
        "and target.json, the table of its landmarks that fleet-calibrate reads.",
    )
    parser.add_argument("folder", nargs="?", default="box", metavar="FOLDER", help="where to write (default: box)")
    for name, meaning in _LENGTHS.items():
        parser.add_argument(
            _option(name), type=float, metavar="MM", help=f"{meaning}, in mm (default: {mm(_DEFAULT[name])})"
        )
    for name, meaning in _COUNTS.items():
        parser.add_argument(_option(name), type=int, metavar="N", help=f"{meaning} (default: {_DEFAULT[name]})")
    parser.add_argument(
        "--dictionary", metavar="NAME", help=f"tag family, by OpenCV's name (default: {_DEFAULT['dictionary']})"
    )
    parser.add_argument("--paper", choices=["a4", "letter", "both"], default="both", help="paper to print on (default: both)")
    return parser


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _box(args: argparse.Namespace) -> Box:
    """Return the box that the options describe; millimetres end here (30.1 mm as 0.0301 m, without idle digits)."""
    given = {name: value for name in _DEFAULT if (value := getattr(args, name)) is not None}
    return Box(**{name: round(value / 1000, 12) if name in _LENGTHS else value for name, value in given.items()})


def _refuse_other_target(folder: Path, target: Target) -> None:
    """Refuse to replace another box's files: sheets that were printed from them, and logs, need them."""
    path = folder / TARGET_NAME
    if not path.exists():
        return
    try:
        same = load_target(path).box == target.box
    except TargetError as error:
        raise TargetError(
            f"{path}: stands there already and is no target that this version reads; name another FOLDER, or remove it"
        ) from error
    if not same:
        raise TargetError(
            f"{folder}: its {TARGET_NAME} describes a box with other figures, and printed sheets may depend on it; "
            "name another FOLDER, or remove that one's files first"
        )


def _write_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files so that a full disk leaves none of them half written, nor some without the others."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in files:
        if (folder / name).is_dir():
            raise TargetError(f"{folder / name}: is a folder, a file is to be written there; name another FOLDER")
    with tempfile.TemporaryDirectory(dir=folder, prefix=".make-target.") as staging:
        for name, content in files.items():
            write_atomically(Path(staging) / name, content)
        for name in files:
            (Path(staging) / name).replace(folder / name)


if __name__ == "__main__":
    sys.exit(main())
