"""Robots of one box, as the joint solution speaks to them: what each said last, and what is asked of all."""

from collections.abc import Callable, Iterable, Sequence
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
        self.parts = [_told(part) for part in run(partial(begin, names=prior.names), members)]
        self.there = [k for k, part in enumerate(self.parts) if part.block is not None]

    @property
    def names(self) -> list[str]:
        """Names of the robots that have a part."""
        return [self._members[k].job.robot for k in self.there]

    @property
    def blocks(self) -> list[Block]:
        """Information of the robots that have a part, each at the shape that it found by itself."""
        return self._blocks(np.zeros(len(self._prior.names)))

    def _blocks(self, shape: Array) -> list[Block]:
        """Return what was said last, freed at a shape of all that no robot can tell."""
        free = gauge_free(self._prior, shape)
        return [block.projected(free) for k in self.there if (block := self.parts[k].block) is not None]

    @property
    def problems(self) -> dict[str, BoxcalError]:
        """Reasons why robots have no part, by name."""
        pairs = zip(self._members, self.parts, strict=True)
        return {member.job.robot: part.problem for member, part in pairs if part.problem is not None}

    def ask(self, shape: Array) -> list[Block]:
        """Send a shape (m,) to all that have a part, and return their information there."""
        work, rows = partial(follow, names=self._prior.names, shape=shape), self.there
        told = self._run(work, [self._members[k] for k in rows], [self.parts[k] for k in rows])
        for k, part in zip(rows, told, strict=True):
            self.parts[k] = part or self.parts[k]  # of one that was lost what it said last still holds
        return self._blocks(shape)


def _told(part: Part | None) -> Part:
    """Return a robot's part, also where nothing came back."""
    return part or Part(problem=CalibError("the process that worked on it was lost", remedy="give fewer --jobs"))
