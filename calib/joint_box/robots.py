"""Robots of one box, as the joint solution speaks to them: what each said last, and what is asked of all."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.joint_box.block import Block
from boxcal.calib.joint_box.gauge import gauge_free
from boxcal.calib.joint_box.one_of_many import Member, Part, begin, follow
from boxcal.calib.joint_box.shape_prior import ShapePrior
from boxcal.target.arrays import Array
from boxcal.target.errors import BoxcalError

Run = Callable[..., Iterable[Any]]
"""Does work on many robots: as ``map`` does over several sequences, results in their order; None where one was lost."""


class Robots:
    """The robots of one box, begun each by itself.

    Parameters
    ----------
    members
        Robots whose jobs have one target.
    prior
        What is known of the box before.
    run
        What does the work on all robots.
    """

    def __init__(self, members: Sequence[Member], prior: ShapePrior, run: Run) -> None:
        self._members, self._prior, self._run = members, prior, run
        free = gauge_free(prior, np.zeros(len(prior.names)))
        self.parts = [_freed(_told(part), free) for part in run(partial(begin, names=prior.names), members)]
        self.there = [k for k, part in enumerate(self.parts) if part.block is not None]

    @property
    def names(self) -> list[str]:
        """Names of the robots that have a part."""
        return [self._members[k].job.robot for k in self.there]

    @property
    def blocks(self) -> list[Block]:
        """Information of the robots that have a part, as they said it last; free of what no robot can tell."""
        return [block for k in self.there if (block := self.parts[k].block) is not None]

    @property
    def problems(self) -> dict[str, BoxcalError]:
        """Reasons why robots have no part, by name."""
        pairs = zip(self._members, self.parts, strict=True)
        return {member.job.robot: part.problem for member, part in pairs if part.problem is not None}

    def ask(self, shape: Array) -> list[Block]:
        """Send a shape (m,) to all that have a part, and return their information there."""
        work, rows = partial(follow, names=self._prior.names, shape=shape), self.there
        free, sent = gauge_free(self._prior, shape), (replace(self.parts[k], block=None) for k in rows)
        for k, part in zip(rows, self._run(work, [self._members[k] for k in rows], sent), strict=True):
            if part is not None and part.block is not None:  # else what it said last still holds
                self.parts[k] = _freed(part, free)
        return self.blocks


def _freed(part: Part, free: Array) -> Part:
    return part if part.block is None else replace(part, block=part.block.projected(free))


def _told(part: Part | None) -> Part:
    """Return a robot's part, also where nothing came back."""
    return part or Part(problem=CalibError("the process that worked on it was lost", remedy="give fewer --jobs"))
