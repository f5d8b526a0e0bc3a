"""Stops looked at again where the box is not as described: printed in another size, or glued elsewhere."""

from collections.abc import Callable
from dataclasses import dataclass

from boxcal.detect.stops import Stop
from boxcal.detect.tags.averaging import AveragedCorners
from boxcal.detect.tags.box_at_stops import BoxAtStops, KnownBox
from boxcal.detect.tags.print_size import print_sizes, scaled_prints
from boxcal.target.box import Target

MOST_LOST = 0.9
"""Under a box that is believed no fewer tags are found than this fraction of those under the box as described."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenStop:
    """A usable stop: its number among all, from 0, what was seen, and how many tags were rejected."""

    number: int
    stop: Stop
    corners: AveragedCorners
    rejected: int


Seen = tuple[BoxAtStops, list[SeenStop]]
"""Who looked at the stops, and what was seen at each that is usable."""


def as_built(
    found: Seen,
    target: Target,
    tell: Callable[[str, float], None],
    seen_with: Callable[[Target, KnownBox | None], Seen],
) -> tuple[Seen, Target]:
    """Return what stops show of the box as it was built, and that box; what was found, where it is as described.

    Parameters
    ----------
    found, target
        What they show of the box as described, and that.
    tell
        Called with the reason why stops are looked at again.
    seen_with
        Looks at all stops for a box.
    """
    scale, box = found[0].print_scale(), target
    if scale != 1.0:
        tell(f"tags of two faces fit prints of {scale:.0%} only: looking again", 0.0)
        again = seen_with(scaled_prints(target, scale), None)
        if again[0].tags > found[0].tags:  # one image determined the size: the others must bear it out
            found, box = again, scaled_prints(target, scale)
    look = found[0]
    built = look.built_box(_corners(found))
    if built is not None:
        tell("the box is not printed or glued as described: its tags are measured again where they lie", 0.0)
        again = seen_with(built.target, built)
        if again[0].tags >= MOST_LOST * found[0].tags:
            found, box = again, built.target
            if print_sizes(target, built.target):
                better = look.built_box(_corners(again)) or built
                again[0].print_sizes = print_sizes(target, better.target)
    return found, box


def _corners(found: Seen) -> dict[int, AveragedCorners]:
    return {seen.number: seen.corners for seen in found[1]}
