"""Boxes that are ready made; light, for a command's ``--help`` shows their dimensions."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """A ready-made box and how it is printed.

    Attributes
    ----------
    figures
        Of :class:`~boxcal.target.box.Box`, by name; lengths in m.
    papers
        What its sheets are printed on.
    tile
        Whether faces that are larger than the paper are printed in tiles.
    what
        What it is for.
    """

    figures: Mapping[str, float | int | str]
    papers: tuple[str, ...]
    tile: bool
    what: str


PRESETS = {
    "default": Preset(
        figures={
            "width": 0.25,
            "depth": 0.25,
            "height": 0.20,
            "columns": 7,
            "rows": 5,
            "tag_size": 0.028,
            "pitch": 0.035,
            "first_id": 0,
            "dictionary": "DICT_APRILTAG_36h11",
        },
        papers=("a4", "letter"),
        tile=False,
        what="for robots from Khepera to TurtleBot size",
    ),
    # Tags of 8 modules of 6 mm, two modules apart; half a face is 250 x 380 mm: two A3 or six A4 sheets a face.
    "large": Preset(
        figures={
            "width": 0.50,
            "depth": 0.50,
            "height": 0.38,
            "columns": 8,
            "rows": 6,
            "tag_size": 0.048,
            "pitch": 0.060,
            "first_id": 0,
            "dictionary": "DICT_APRILTAG_36h11",
        },
        papers=("a3", "a4"),
        tile=True,
        what="for larger mobile robots, its faces in tiles",
    ),
}
