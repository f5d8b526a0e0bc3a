"""Rounds between the robots and the box: blocks are summed and solved, the shape is sent back, until it stays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from boxcal.calib.joint_box.agreement import FALSE_ALARM, Agreement, agreement
from boxcal.calib.joint_box.block import Block
from boxcal.calib.joint_box.shape_prior import ShapePrior
from boxcal.target.arrays import Array

CONVERGED = 1e-6
"""A shape that moves by less than this (square, in units of its sigma) stays."""
_ROUNDS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joined:
    """Shape on which all robots agree that saw one box.

    Attributes
    ----------
    agreement
        Which they are, and the shape's distribution.
    blocks
        Of all robots, at the last shape but one.
    rounds
        How often the shape was sent to the robots.
    converged
        Whether it stayed in the end.
    """

    agreement: Agreement
    blocks: tuple[Block, ...]
    rounds: int
    converged: bool


def join(
    first: Sequence[Block],
    prior: ShapePrior,
    ask: Callable[[Array], Sequence[Block]],
    *,
    false_alarm: float = FALSE_ALARM,
    tolerance: float = CONVERGED,
    components: dict[str, float] | None = None,
) -> Joined:
    """Return the shape of the box that the robots agree on.

    Parameters
    ----------
    first
        Block of each robot at the shape that it found by itself.
    prior
        What is known of the box before; it counts once.
    ask
        Sends a shape to all robots, and returns their blocks there, in the same order.
    false_alarm
        Chance that a fleet of robots that all saw one box has any of them left out.
    tolerance
        Square of the shape's last move, in units of its sigma.
    components
        Variance components of the prior, held; found from the robots if not given.
    """
    blocks = tuple(first)
    start, estimated = components or prior.usual, components is None
    found = agreement(blocks, prior, start, false_alarm=false_alarm, estimate_components=estimated)
    for n in range(1, _ROUNDS + 1):
        before = found.posterior
        blocks = tuple(ask(before.shape))
        found = agreement(
            blocks,
            prior,
            before.components,
            false_alarm=false_alarm,
            estimate_components=estimated and n < _ROUNDS // 2,
        )
        moved = found.posterior.shape - before.shape
        information = found.posterior.data.information + found.posterior.prior
        left = max((b.left for b, counts in zip(blocks, found.counts, strict=True) if counts), default=0.0)
        if float(moved @ information @ moved) < tolerance and left < max(tolerance, 1e-6):
            return Joined(agreement=found, blocks=blocks, rounds=n, converged=True)
    return Joined(agreement=found, blocks=blocks, rounds=_ROUNDS, converged=False)
