"""Sizes of paper; light, for a command's ``--help`` lists them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Paper:
    """A size of paper.

    Attributes
    ----------
    name
        As people call it.
    short, long : m
        Its sides.
    """

    name: str
    short: float
    long: float


PAPERS = {
    "a4": Paper(name="A4", short=0.210, long=0.297),
    "letter": Paper(name="US Letter", short=0.2159, long=0.2794),
    "a3": Paper(name="A3", short=0.297, long=0.420),
}
"""What sheets are printed on."""

NET_PAPERS = PAPERS | {
    "a2": Paper(name="A2", short=0.420, long=0.594),
    "a1": Paper(name="A1", short=0.594, long=0.841),
    "a0": Paper(name="A0", short=0.841, long=1.189),
}
"""What fold-up nets are printed on."""

MM = 1000


def mm(length: float) -> str:
    """Return a length in m as text in mm, to 0.01 mm and without idle zeros."""
    return f"{length * MM:.2f}".rstrip("0").rstrip(".")
