"""The guide that is printed with a box: the assembly page and the record card."""

from functools import partial

from boxcal.target.box import Target
from boxcal.target.print.assembly import draw_assembly
from boxcal.target.print.card import draw_card
from boxcal.target.print.ink import write_pdf
from boxcal.target.print.papers import Paper


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
