"""Descriptions of the robot, which a server sends once: kept so that a further drive has them, too."""

from collections.abc import Sequence

from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.detect.log.topic_use import Use, use_of
from boxcal.detect.log.topics import Topics

_MOST_BYTES = 8 << 20


class Descriptions:
    """Holds what describes the robot: its parts, fixed transforms and parameters."""

    def __init__(self) -> None:
        self._held: list[LiveMessage] = []
        self._bytes = 0
        self._about: dict[tuple[str, str], bool] = {}

    def keep(self, messages: Sequence[LiveMessage], topics: Topics) -> None:
        """Hold what describes the robot among messages, as long as it is not unreasonably much."""
        for message in messages:
            channel = message.channel
            known = (channel.topic, channel.type)
            if known not in self._about:
                self._about[known] = use_of(channel, topics) is Use.ABOUT
            if self._about[known] and self._bytes + message.size <= _MOST_BYTES:
                self._held.append(message)
                self._bytes += message.size

    def again(self, log_ns: int) -> list[LiveMessage]:
        """Return all that is held, as if it had come at a time, ns."""
        return [message._replace(log_ns=log_ns) for message in self._held]
