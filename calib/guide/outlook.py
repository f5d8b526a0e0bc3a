"""The wishes that a session begins with, and the state of the drive as the driver needs it."""

from dataclasses import dataclass, field
from pathlib import Path

from boxcal.calib.guide.drive.glance import Glance
from boxcal.calib.guide.estimate.advice import Place
from boxcal.calib.planning.goal import Bar, Goal
from boxcal.calib.settings import Settings
from boxcal.target.box import Target


@dataclass(frozen=True, slots=True, kw_only=True)
class GuideOptions:
    """Options of a session.

    Attributes
    ----------
    robot
        Name of the robot, of its recording and of its results.
    target
        The box.
    settings
        Topics, units and nominal wheels.
    recordings, out
        Folders of the recording and of the results.
    goal
        Standard deviations that are enough.
    command
        The command line, for the provenance of the results.
    """

    robot: str
    target: Target
    settings: Settings
    recordings: Path
    out: Path
    goal: Goal = field(default_factory=Goal)
    command: str = ""


@dataclass(slots=True, kw_only=True, eq=False)
class Outlook:
    """The state of the drive as the driver needs it: what is known and what comes next.

    Attributes
    ----------
    seen
        The last look at an image.
    bars
        How far the goals are.
    places
        Where to stop next.
    placed_after
        How many stops were taken when those were planned; -1 before.
    taken_at
        Steady time, s, at which the last stop was taken, and how many stops then were.
    latency
        Time from a stop's being due to its bars' being known, s.
    """

    seen: Glance | None = None
    bars: tuple[Bar, ...] = ()
    places: tuple[Place, ...] = ()
    placed_after: int = -1
    taken_at: tuple[float, int] = (0.0, 0)
    latency: float = 0.0
