"""All robots of one box solved together: its refined shape, and every robot's calibration with it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from boxcal.calib.errors import CalibError
from boxcal.calib.joint_box.block import Block, inverse
from boxcal.calib.joint_box.difference import difference
from boxcal.calib.joint_box.one_of_many import Member, Part
from boxcal.calib.joint_box.robots import LEAST_ROBOTS, Robots, Run
from boxcal.calib.joint_box.rounds import Joined, join
from boxcal.calib.joint_box.shape_prior import ShapePrior, shape_prior
from boxcal.calib.joint_box.sharpness import Sharpness, ruler
from boxcal.calib.one_robot.solving import options_of
from boxcal.target.box import Target
from boxcal.target.errors import BoxcalError

MOST_OFF = 3.0
"""How far a robot's box may lie from the common one, in standard deviations of its own estimate: what it is given
for its own must not be further off than three sigmas, even if two boxes hide behind the scatter."""
MOST_SPREAD = MOST_OFF**2
"""Largest scatter of the robots that is one box, as a variance in units of their noise. Fleets of one box have 1.0 to
2.8; two boxes made by hand differ so much that half and half of them have thousands."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointBox:
    """Shape of one box that its robots found together.

    Attributes
    ----------
    target
        The box, refined, with its covariance.
    members
        The robots that were to take part.
    prior
        What was known of the box before.
    blocks
        Information of each robot; None of one that was left out.
    left_out
        Why a robot was left out, by name.
    joined
        The joint solution, of those that took part.
    before, after
        How well the shape was known to the middle one of the robots, and is to all of them.
    """

    target: Target
    members: tuple[Member, ...]
    prior: ShapePrior
    blocks: tuple[Block | None, ...]
    left_out: dict[str, BoxcalError]
    joined: Joined
    before: Sharpness
    after: Sharpness

    @property
    def robots(self) -> int:
        """Number of robots that the shape was found from."""
        return sum(block is not None for block in self.blocks)

    def without(self, k: int) -> Target | BoxcalError | None:
        """Return the box without the information of one of its robots: all that its own calibration may take as known.

        None for a robot that was left out; an error where the others' estimate makes no box.
        """
        block = self.blocks[k]
        if block is None:
            return None
        try:
            return self.prior.refined(*self.joined.agreement.posterior.without(block), (), self.robots - 1)
        except BoxcalError as error:
            return error


def solve_box(members: Sequence[Member], run: Run = map) -> JointBox:
    """Return the shape of the box that robots drove around, found by all of them together.

    Every robot gives what it knows of the shape, everything of its own eliminated; that is summed with what was known
    before, solved for, and sent back until nothing moves. A robot whose box differs from that of the others beyond
    chance is left out. What was found of the box in earlier runs is not counted: they may have been of the same drives.

    Parameters
    ----------
    members
        Robots whose jobs have one target.
    run
        What does the work on all robots; None stands for what was lost.

    Raises
    ------
    CalibError
        If fewer than two robots can take part, or no majority of them saw one box.
    """
    members = [replace(m, job=replace(m.job, target=m.job.target.unrefined)) for m in members]
    prior = shape_prior(options_of(members[0].job))
    robots = Robots(members, prior, run)
    joined = join(robots.blocks, prior, robots.ask)
    _check_majority(joined, robots.names)
    left_out = robots.problems | _of_another_box(robots.names, joined, prior)
    return _concluded(members, robots.parts, prior, joined, left_out)


def _check_majority(joined: Joined, names: Sequence[str]) -> None:
    found = joined.agreement
    if found.posterior.spread > MOST_SPREAD:
        raise CalibError(
            f"the robots' boxes differ by {found.posterior.spread**0.5:.1f} times what their noise explains",
            remedy="were there two boxes, or were sheets glued anew between drives? Calibrate those apart",
        )
    if not found.majority or int(found.counts.sum()) < LEAST_ROBOTS:
        agree = [name for name, counts in zip(names, found.counts, strict=True) if counts]
        raise CalibError(
            f"the robots' boxes differ: no more than {len(agree)} of {len(names)} robots "
            f"agree on one ({', '.join(agree[:5])}{' ...' if len(agree) > 5 else ''})",
            remedy="was it another copy, or were its sheets glued anew between drives? Calibrate those apart",
        )


def _of_another_box(names: Sequence[str], joined: Joined, prior: ShapePrior) -> dict[str, BoxcalError]:
    found, out = joined.agreement, dict[str, BoxcalError]()
    for name, block, counts in zip(names, joined.blocks, found.counts, strict=True):
        if not counts:
            what = difference(block, found.posterior, prior)
            out[name] = CalibError(
                f"its box differs from that of the {int(found.counts.sum())} others: {what}",
                remedy="left out of the joint solution; was it another copy, or were its sheets glued anew?",
            )
    return out


def _concluded(
    members: Sequence[Member],
    parts: Sequence[Part],
    prior: ShapePrior,
    joined: Joined,
    left_out: dict[str, BoxcalError],
) -> JointBox:
    """Return the refined box, and what gives each robot the box without its own information."""
    found = joined.agreement.posterior
    taking = iter(joined.blocks)
    blocks = [None if part.block is None else next(taking) for part in parts]
    blocks = [None if m.job.robot in left_out else b for m, b in zip(members, blocks, strict=True)]
    counting = [(part, block) for part, block in zip(parts, blocks, strict=True) if block is not None]
    everything = tuple(name for part, _ in counting for name in part.drives)
    target = prior.refined(found.shape, found.cov, everything, len(counting))
    measure = ruler(target, prior.names)
    alone = [measure.of(inverse(block.information + found.prior)) for _, block in counting]
    return JointBox(
        target=target,
        members=tuple(members),
        prior=prior,
        blocks=tuple(blocks),
        left_out=left_out,
        joined=joined,
        before=sorted(alone, key=lambda s: s.shape)[len(alone) // 2],
        after=measure.of(found.cov),
    )
