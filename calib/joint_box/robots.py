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
LOST = "the process that worked on it was lost"
LEAST_ROBOTS = 2
"""With fewer robots there is nothing to solve together."""
_MISSES = 2
"""A robot that fails to follow the shape this many times in a row is left out."""


class Robots:
    """The robots of one box, begun each by itself; a drive that two of them have counts once.

    Parameters
    ----------
    members
        Robots whose jobs have one target.
    prior
        What is known of the box before.
    run
        What does the work on all robots.

    Raises
    ------
    CalibError
        If fewer than two robots can take part.
    """

    def __init__(self, members: Sequence[Member], prior: ShapePrior, run: Run) -> None:
        self._members, self._prior, self._run = members, prior, run
        free = gauge_free(prior, np.zeros(len(prior.names)))
        begun = run(partial(begin, names=prior.names), members)
        self.parts = _each_drive_once([_freed(_part_or_loss(part), free) for part in begun], members)
        self._missed = [0] * len(self.parts)
        self._check()

    @property
    def there(self) -> list[int]:
        """Numbers of the robots that have a part."""
        return [k for k, part in enumerate(self.parts) if part.block is not None]

    @property
    def names(self) -> list[str]:
        """Names of the robots that have a part."""
        return [self._members[k].job.robot for k in self.there]

    @property
    def blocks(self) -> list[Block]:
        """Information of the robots that have a part, as they said it last; free of what no robot can determine."""
        return [block for k in self.there if (block := self.parts[k].block) is not None]

    @property
    def problems(self) -> dict[str, BoxcalError]:
        """Reasons why robots have no part, by name."""
        pairs = zip(self._members, self.parts, strict=True)
        return {member.job.robot: part.problem for member, part in pairs if part.problem is not None}

    def ask(self, shape: Array) -> list[Block]:
        """Send a shape (m,) to all that have a part, and return their information there.

        What a robot that does not follow said last holds once more, marked as not settled (``left`` is infinite); after
        that it has no part.

        Raises
        ------
        CalibError
            If fewer than two robots are left.
        """
        work, rows = partial(follow, names=self._prior.names, shape=shape), self.there
        free, sent = gauge_free(self._prior, shape), (replace(self.parts[k], block=None) for k in rows)
        for k, part in zip(rows, self._run(work, [self._members[k] for k in rows], sent), strict=True):
            if part is None or part.block is None:
                self.parts[k] = self._missing(k)
            else:
                self.parts[k], self._missed[k] = _freed(part, free), 0
        self._check()
        return self.blocks

    def _missing(self, k: int) -> Part:
        """Return the part of a robot that did not follow."""
        self._missed[k] += 1
        before = self.parts[k]
        if before.block is None or self._missed[k] >= _MISSES:
            return Part(problem=CalibError("its solution does not follow the shape of the box that the others found"))
        return replace(before, block=replace(before.block, left=np.inf))

    def _check(self) -> None:
        if len(self.there) < LEAST_ROBOTS:
            raise CalibError(
                f"{len(self.there)} of {len(self.parts)} robots can take part in the joint solution",
                needed=f"at least {LEAST_ROBOTS} are needed",
                remedy="leave out --joint-box",
            )


def _each_drive_once(parts: Sequence[Part], members: Sequence[Member]) -> list[Part]:
    """Return the parts without those of robots one of whose drives a robot before them has."""
    whose: dict[str, str] = {}
    out = []
    for part, member in zip(parts, members, strict=True):
        if part.block is not None:
            same = [whose[drive] for drive in part.drives if drive in whose]
            if same:
                problem = CalibError(f"its drive is that of {same[0]}", remedy="give each drive once, by one name")
                out.append(Part(problem=problem))
                continue
            whose |= dict.fromkeys(part.drives, member.job.robot)
        out.append(part)
    return out


def _freed(part: Part, free: Array) -> Part:
    return part if part.block is None else replace(part, block=part.block.projected(free))


def _part_or_loss(part: Part | None) -> Part:
    """Return a robot's part, also where nothing came back."""
    return part or Part(problem=CalibError(LOST, remedy="give fewer --jobs"))
