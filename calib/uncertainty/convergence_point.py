"""Estimate from some of a drive's stops, as results keep it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvergencePoint:
    """The estimate from the first stops only (the paper's figures 8 and 9).

    Attributes
    ----------
    stops
        How many were used.
    values, sigma : (14,)
        In the order of ``ORDER``; for rx, ry, rz the difference from the final extrinsics.
    """

    stops: int
    values: tuple[float, ...]
    sigma: tuple[float, ...]
