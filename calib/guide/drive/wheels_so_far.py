"""The wheels of a drive that still goes on, read by what reads finished recordings."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Batch, Channel
from boxcal.detect.log.readings import problems_said
from boxcal.detect.log.scan import Scan
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_assembly import AssembledWheels, assemble_wheels
from boxcal.detect.log.wheel_choice import WheelChoice, choose_wheels
from boxcal.detect.log.wheel_samples import WheelUnits


class WheelsSoFar:
    """Takes the messages of wheels as they come, in any order, and gives the samples so far.

    Attributes
    ----------
    scan
        What was heard; its metadata describe the robot.
    choice
        The signals that the last samples came from; None before the first.
    problem
        Sentence about why there are no samples, empty if there are.
    """

    def __init__(self, name: str, topics: Topics, units: WheelUnits, nominal: tuple[float, float] | None) -> None:
        self.scan = Scan(name=name, topics=topics)
        self.choice: WheelChoice | None = None
        self.problem = ""
        self._units, self._nominal = units, nominal

    def take(self, messages: Sequence[LiveMessage]) -> None:
        """Take messages that are no images (DetectError if there are unreasonably many)."""
        by_channel: dict[int, tuple[Channel, list[LiveMessage]]] = {}
        for message in messages:
            by_channel.setdefault(id(message.channel), (message.channel, []))[1].append(message)
        self.scan.take([_batch(channel, of_channel) for channel, of_channel in by_channel.values()])

    @property
    def heard(self) -> bool:
        """Whether anything was heard that may be a wheel."""
        return bool(self.scan.readings.signals or self.scan.readings.odometry)

    @property
    def resting_since_ns(self) -> tuple[int, int] | None:
        """First and last stamp (ns) of wheels that were heard and never moved; None if there are none, or they did."""
        signals = [s for of_topic in self.scan.readings.signals.values() for s in of_topic.values() if s.count]
        if not signals or any(s.moves for s in signals) or any(o.moves for o in self.scan.readings.odometry.values()):
            return None
        t_ns = signals[0].t_ns if signals[0].stamped and np.any(signals[0].t_ns) else signals[0].log_ns
        return int(t_ns.min()), int(t_ns.max())

    def samples(self) -> AssembledWheels | None:
        """Return the wheel samples so far; None where there are none yet, and :attr:`problem` says why."""
        scan = self.scan
        try:
            choice = choose_wheels(scan.name, scan.readings.signals, scan.readings.odometry, scan.types, scan.topics)
            nominal = self._nominal or scan.readings.metadata.nominal_wheels()
            found = assemble_wheels(scan.name, choice, self._units, nominal)
        except DetectError as error:
            self.problem = str(error).removeprefix(f"{scan.name}: ")
            return None
        self.choice, self.problem = choice, ""
        return found

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about messages that did not decode."""
        return tuple(problems_said(self.scan.readings.problems))


def _batch(channel: Channel, messages: list[LiveMessage]) -> Batch:
    ends = np.cumsum([len(m.data) for m in messages], dtype=np.int64)
    return Batch(
        channel=channel,
        data=b"".join(m.data for m in messages),
        starts=np.concatenate([[0], ends[:-1]]),
        ends=ends,
        log_ns=np.array([m.log_ns for m in messages], dtype=np.int64),
        record=0,
    )
