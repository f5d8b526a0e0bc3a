"""The guide that is printed with a box: the assembly page and the record card."""

from functools import partial

from target.box import Target
from target.paper.assembly import draw_assembly
from target.paper.card import draw_card
from target.paper.ink import write_pdf
from target.paper.papers import Paper


def guide_pdf(target: Target, paper: Paper) -> bytes:
    """Return a PDF of two upright pages: how to build the box, and its record card."""
    width, height = paper.short, paper.long
    return write_pdf(
        target,
        f"guide on {paper.name}",
        [
            (width, height, partial(draw, target=target, width=width, height=height))
            for draw in (draw_assembly, draw_card)
        ],
    )
