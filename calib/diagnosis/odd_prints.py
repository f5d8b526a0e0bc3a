"""Prints of unlike sizes on one box: taken as they are, since the box's own unknowns have one size for all."""

from collections.abc import Sequence

from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.tags.print_size import ODD, scaled_prints
from boxcal.target.box import Target


def with_odd_prints(drives: Sequence[Correspondences], target: Target) -> tuple[Target, Finding] | None:
    """Return the box with prints of the sizes that the images of its first drive show, and what is said of that.

    None where they are alike, and around a box whose shape is known already. How well the sizes are known is in no
    sigma, so that such a result is not good.
    """
    sizes = next((drive.source.print_sizes for drive in drives if drive.source.print_sizes), ())
    odd = [face for face, size in enumerate(sizes) if abs(size - 1) > ODD]
    if not odd or target.refined is not None:
        return None
    each = ", ".join(f"{f}: {100 * sizes[f]:.1f} %" for f in odd)
    size = max((sizes[f] - 1 for f in odd), key=abs)
    finding = Finding(
        cause="odd-print",
        text=f"prints are of unlike sizes, against most (sheet: size) {each}; taken into account",
        advice="Print all sheets at 100 %, with one printer, and glue them anew.",
        size=100 * size,
        unit="%",
    )
    return scaled_prints(target, sizes), finding
