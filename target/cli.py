"""The command ``make-target``: a box's dimensions in, its landmark table, paper and models out."""

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from boxcal.command_line import CommandParser
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_together
from boxcal.target.models.products import missing_modules, products
from boxcal.target.presets import PRESETS, Preset
from boxcal.target.print.papers import NET_PAPERS, PAPERS, mm

if TYPE_CHECKING:
    from boxcal.target.box import Box, Target

TARGET_NAME = "target.json"

_LENGTHS = {
    "width": "along x",
    "depth": "along y",
    "height": "along z",
    "tag_size": "outer edge of a tag's black border",
    "pitch": "from one tag's centre to the next, along both axes",
}
_COUNTS = {
    "columns": "tags across a face",
    "rows": "tags down a face",
    "first_id": "id of face 0's top left tag; ids run on by columns, rows and faces; no two boxes of a site share any",
}
_GUIDE_PAPER = {"a4": "a4", "letter": "letter", "a3": "a4"}
"""What the guide to a box is printed on."""
_ALL_NETS = ("a2", "a1")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Item:
    """Something to write: a file or folder, what is in it, and its files by their paths."""

    name: str
    what: str
    make: Callable[[], Mapping[str, bytes]]


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``make-target``; return 0 if all was written, 1 if something could not be made (argparse exits with 2)."""
    args = _parser().parse_args(argv)
    folder = Path(args.folder)
    try:
        return _list(args) if args.list else _write(args, folder)
    except TargetError as error:
        print(f"make-target: {error}", file=sys.stderr)
    except OSError as error:
        print(
            f"make-target: {folder}: cannot be written ({error.strerror or error}); name another FOLDER",
            file=sys.stderr,
        )
    return 1


def _parser() -> argparse.ArgumentParser:
    figures = PRESETS["default"].figures
    parser = CommandParser(
        "make-target",
        description="example:\n"
        "  make-target box            the default box: box/target.json, sheets and guide on A4 and US Letter\n"
        "  make-target small --width 120 --depth 120 --height 120 --columns 3 --rows 3 --paper a4\n"
        "  make-target amr --preset large --first-id 192 --list\n\n"
        "Make the landmark box that robots are calibrated with: printable sheets of its four faces in exact size, the\n"
        "guide to building it with a record card, and target.json, the table of its landmarks that fleet-calibrate\n"
        "reads; on demand a fold-up net, CAD and cut files, and models for simulators.",
    )
    parser.add_argument("folder", nargs="?", default="box", metavar="FOLDER", help="where to write (default: box)")
    presets = "; ".join(f"{name}: {_size(preset)}, {preset.what}" for name, preset in PRESETS.items())
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        default="default",
        help=f"dimensions and papers to start from, which other options change ({presets})",
    )
    for name, meaning in _LENGTHS.items():
        parser.add_argument(
            _option(name), type=float, metavar="MM", help=f"{meaning}, in mm (default: {mm(float(figures[name]))})"
        )
    for name, meaning in _COUNTS.items():
        parser.add_argument(_option(name), type=int, metavar="N", help=f"{meaning} (default: {figures[name]})")
    parser.add_argument(
        "--dictionary",
        metavar="NAME",
        help=f"tag family, AprilTag or ArUco, by OpenCV's name (default: {figures['dictionary']})",
    )
    parser.add_argument(
        "--paper",
        choices=[*PAPERS, "both"],
        help="paper for the sheets; both is a4 and letter (default: both; for the large preset a3 and a4)",
    )
    parser.add_argument(
        "--tile",
        action="store_true",
        help="print faces that are larger than the paper in tiles, joined between the tags (the large preset does)",
    )
    parser.add_argument(
        "--net",
        choices=NET_PAPERS,
        action="append",
        default=[],
        help="also a fold-up net with glue flaps, whole, in halves or in tiles as the paper allows; may be repeated",
    )
    parser.add_argument(
        "--models",
        action="store_true",
        help="also models for simulators and pictures of the faces; with the extra boxcal[cad] CAD and cut files, too",
    )
    parser.add_argument(
        "--dpi", type=float, default=300.0, metavar="DPI", help="resolution of the faces' pictures (default: 300)"
    )
    parser.add_argument(
        "--all", action="store_true", help="all of it: --models, and nets on A2, A1 and the papers of the sheets"
    )
    parser.add_argument("--list", action="store_true", help="only show what would be written")
    return parser


def _size(preset: Preset) -> str:
    return " x ".join(mm(float(preset.figures[name])) for name in ("width", "depth", "height")) + " mm"


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _box(args: argparse.Namespace) -> "Box":
    """Return the box that the options describe; millimetres end here (30.1 mm as 0.0301 m, without idle digits)."""
    from boxcal.target.box import Box

    figures: dict[str, Any] = dict(PRESETS[args.preset].figures)
    for name in figures:
        value = getattr(args, name)
        if value is not None:
            figures[name] = round(value / 1000, 12) if name in _LENGTHS else value
    return Box(**figures)


def _list(args: argparse.Namespace) -> int:
    from boxcal.target.box import make_target

    target = make_target(_box(args))
    for item in _paper_items(args, target):
        print(f"{item.name}: {item.what}")
    for item in _model_items(args, target):
        print(f"{item.name}: {item.what}")
    left_out = _left_out(args)
    if left_out:
        print(left_out, file=sys.stderr)
    return 0


def _write(args: argparse.Namespace, folder: Path) -> int:
    from boxcal.target.box import make_target

    target = make_target(_box(args))
    items = list(_paper_items(args, target))
    measured = _refuse_other_target(folder, target)
    files: dict[str, bytes] = {}
    for item in items:
        files.update(item.make())
    for item in _model_items(args, target):
        print(f"making {item.name}", file=sys.stderr)
        files.update(item.make())
        items.append(item)
    if measured:
        del files[TARGET_NAME]
    write_together(folder, files)
    for item in items:
        kept = ", kept as it was measured" if measured and item.name == TARGET_NAME else ""
        print(f"{folder / item.name}: {item.what}{kept}")
    print(
        'Next: print a PDF at 100 % (no "fit to page"), measure its bars: both must be 100 mm long; build the box as '
        "the guide shows, then run measure-target."
    )
    left_out = _left_out(args)
    if left_out:
        print(f"make-target: {left_out}", file=sys.stderr)
    return 1 if left_out else 0


def _paper_items(args: argparse.Namespace, target: "Target") -> Iterator[_Item]:
    """Yield target.json and the PDFs; their pages are drawn here already, for only then it is known that they fit."""
    from boxcal.target.files.target_json import target_bytes
    from boxcal.target.print.guide import guide_pdf
    from boxcal.target.print.net_pages import net_pdf

    ids = f"{target.tag_ids.size} tags, ids {target.tag_ids[0]} to {target.tag_ids[-1]}"
    yield _Item(name=TARGET_NAME, what=ids, make=lambda: {TARGET_NAME: target_bytes(target)})
    papers = _papers(args)
    for paper in papers:
        yield _sheets(args, target, paper)
    for paper in dict.fromkeys(_GUIDE_PAPER[paper] for paper in papers):
        what = f"2 pages of {PAPERS[paper].name}, how to build the box and its record card"
        yield _ready(f"guide-{paper}.pdf", what, guide_pdf(target, PAPERS[paper]))
    for paper in dict.fromkeys([*args.net, *((*_ALL_NETS, *papers) if args.all else ())]):
        pdf, what = net_pdf(target, NET_PAPERS[paper])
        yield _ready(f"net-{paper}.pdf", what, pdf)


def _papers(args: argparse.Namespace) -> tuple[str, ...]:
    if args.paper is None:
        return PRESETS[args.preset].papers
    return ("a4", "letter") if args.paper == "both" else (args.paper,)


def _sheets(args: argparse.Namespace, target: "Target", paper: str) -> _Item:
    from boxcal.target.print.sheets import face_tiles, needs_tiles, sheets_pdf, tiled_pdf

    size = PAPERS[paper]
    if (args.tile or PRESETS[args.preset].tile) and needs_tiles(target.box, size):
        tiles = [len(parts) for _, parts in face_tiles(target, size)]
        what = f"{sum(tiles)} pages of {size.name}, each face in {max(tiles)} tiles"
        return _ready(f"box-{paper}-tiles.pdf", what, tiled_pdf(target, size))
    return _ready(f"box-{paper}.pdf", f"4 pages of {size.name}, one a face", sheets_pdf(target, size))


def _ready(name: str, what: str, content: bytes) -> _Item:
    return _Item(name=name, what=what, make=lambda: {name: content})


def _model_items(args: argparse.Namespace, target: "Target") -> Iterator[_Item]:
    if args.models or args.all:
        for product in products(dpi=args.dpi):
            if not missing_modules(product):
                yield _Item(name=product.name, what=product.what, make=partial(product.make, target))


def _left_out(args: argparse.Namespace) -> str:
    """Return one line about the products whose extra is not installed; empty if there are none."""
    left = [p for p in products(dpi=args.dpi) if missing_modules(p)] if args.models or args.all else []
    if not left:
        return ""
    extras = ",".join(sorted({p.extra for p in left}))
    return f"left out {', '.join(p.name for p in left)}: not installed; pip install 'boxcal[{extras}]'"


def _refuse_other_target(folder: Path, target: "Target") -> bool:
    """Refuse to replace another box's files: sheets that were printed from them, and logs, need them.

    Returns whether the folder's target.json is this box as measured, which is not replaced either.
    """
    from boxcal.target.files.target_json import load_target

    path = folder / TARGET_NAME
    if not path.exists():
        return False
    try:
        found = load_target(path)
    except TargetError as error:
        raise TargetError(
            "stands there already and is no target that this version reads",
            source=path,
            remedy="name another FOLDER, or remove it",
        ) from error
    if found.box != target.box:
        raise TargetError(
            f"its {TARGET_NAME} describes a box with other dimensions, and printed sheets may depend on it",
            source=folder,
            remedy="name another FOLDER, or remove that one's files first",
        )
    return found.measured is not None


if __name__ == "__main__":
    sys.exit(main())
