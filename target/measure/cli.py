"""The command ``measure-target``: what a ruler read on a box in, its true size in target.json out."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from boxcal.command_line import CommandParser
from boxcal.target.errors import TargetError

if TYPE_CHECKING:
    from boxcal.target.box import Box
    from boxcal.target.measure.ruler import Conclusion, Readings

_LENGTHS = {
    "bar_x": ("the 100 mm bar across a sheet", 0.2),
    "bar_y": ("the 100 mm bar up a sheet", 0.2),
    "tags_x": ("all tags of a face together, across, over their black edges (better than the bar: longer)", 0.2),
    "tags_y": ("all tags of a face together, up", 0.2),
    "width": ("the box along x: from face 2 to face 0, over the glued sheets", 0.3),
    "depth": ("the box along y: from face 3 to face 1, over the glued sheets", 0.3),
    "height": ("the box along z (a check: no tag moves with it, for sheets stand on the base)", 0.3),
}
"""What is read, and the sigma in mm that a person with a steel ruler reaches."""
_RULER_PERCENT = 0.02
_FIGURES = {
    "sx": "print scale across",
    "sy": "print scale up",
    "width": "width (x)",
    "depth": "depth (y)",
    "height": "height (z)",
}
_ASK = {
    "sx": "--tags-x (all tags of a face, across), with a caliper or on several faces",
    "sy": "--tags-y (all tags of a face, up), with a caliper or on several faces",
    "width": "--width, with a caliper or at several heights",
    "depth": "--depth, with a caliper or at several heights",
    "height": "--height",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``measure-target``; return 0 if the file was written, 1 if not (argparse exits with 2)."""
    args = _parser().parse_args(argv)
    path = Path(args.target)
    out = path if args.out is None else Path(args.out)
    from boxcal.target.box import make_target
    from boxcal.target.files.target_json import load_target, save_target
    from boxcal.target.measure.ruler import measure

    try:
        before = load_target(path)
        box = before.box
        conclusion = measure(box, _readings(args), ruler_sigma=args.ruler_percent / 100)
        target = make_target(box, conclusion.measured)
        save_target(target, out)
    except TargetError as error:
        print(f"measure-target: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(
            f"measure-target: {out}: cannot be written ({error.strerror or error}); name another --out", file=sys.stderr
        )
        return 1
    for line in _report(box, conclusion):
        print(line)
    if before.refined is not None:
        print(
            "the shape that a fleet found was of the box as it was described before; "
            "fleet-calibrate --joint-box finds it anew"
        )
    print(f"{out}: {target.tag_ids.size} tags where they are measured to be; give it to fleet-calibrate --target")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        "measure-target",
        description="example:\n"
        "  measure-target box/target.json --bar-x 99.7 --bar-y 99.6 --width 250.4 --depth 249.8 --height 200.3\n"
        "  measure-target box/target.json --tags-x 237.2 237.3 --tags-x-sigma 0.1 --out box/measured.json\n\n"
        "Correct a box's target.json by what a ruler or a caliper reads on its prints and on the built box: all\n"
        "results of a calibration scale with it. Read what you can, in mm; several readings of one length may follow\n"
        "its option. The design stays in the file, so measure again whenever you like: the last measurement counts.",
    )
    parser.add_argument(
        "target", nargs="?", default="box/target.json", metavar="TARGET", help="its file (default: box/target.json)"
    )
    for name, (what, _) in _LENGTHS.items():
        parser.add_argument(_option(name), type=float, nargs="+", metavar="MM", help=f"{what}, in mm")
    for name, (_, sigma) in _LENGTHS.items():
        parser.add_argument(
            _option(name) + "-sigma",
            type=float,
            default=sigma,
            metavar="MM",
            help=f"how well one reading of {_option(name)} is known, one sigma, in mm (default: {sigma:g})",
        )
    parser.add_argument(
        "--ruler-percent",
        type=float,
        default=_RULER_PERCENT,
        metavar="PERCENT",
        help=f"how far the ruler itself may be off, one sigma, common to all lengths (default: {_RULER_PERCENT:g})",
    )
    parser.add_argument("--out", metavar="FILE", help="where to write (default: TARGET itself)")
    return parser


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _readings(args: argparse.Namespace) -> "Mapping[str, Readings]":
    from boxcal.target.measure.ruler import Readings

    return {
        name: Readings(values=tuple(v / 1000 for v in values), sigma=getattr(args, f"{name}_sigma") / 1000)
        for name in _LENGTHS
        if (values := getattr(args, name)) is not None
    }


def _report(box: "Box", conclusion: "Conclusion") -> list[str]:
    """Return what was concluded, line by line: each dimension, the whole box's scale, and what to measure better."""
    lines = []
    measured = conclusion.measured
    for k, (figure, what) in enumerate(_FIGURES.items()):
        value, sigma = getattr(measured, figure), measured.cov[k, k] ** 0.5
        if figure in {"sx", "sy"}:
            text = f"{value * 100:8.2f} +- {sigma * 100:.2f} %"
        else:
            text = f"{value * 1e3:8.2f} +- {sigma * 1e3:.2f} mm, designed {getattr(box, figure) * 1e3:g}"
        lines.append(f"{what:<19}{text}" + ("" if figure in conclusion.read else ", not measured"))
    lines.append(
        f"{'the box as a whole':<19}{conclusion.scale * 100:8.2f} +- {conclusion.scale_sigma * 100:.2f} % of its "
        "design: rL, rR, b and t can be no better than that"
    )
    up = measured.sy * box.height - measured.height
    if "height" in conclusion.read and abs(up) > 0.002:
        lines.append(
            f"the prints are {abs(up) * 1e3:.1f} mm {'higher' if up > 0 else 'lower'} than the box; glue them with "
            "their lower edges on its base: that is where the file takes them to be"
        )
    k = int(conclusion.shares.argmax())
    figure = list(_FIGURES)[k]
    if conclusion.ruler > conclusion.shares[k]:
        lines.append(f"measure better: with a truer ruler, which makes {conclusion.ruler:.0%} of that variance")
    else:
        lines.append(f"measure better: {_ASK[figure]}; it makes {conclusion.shares[k]:.0%} of that variance")
    return lines


if __name__ == "__main__":
    sys.exit(main())
