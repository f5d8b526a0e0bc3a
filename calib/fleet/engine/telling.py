"""Messages of a call while it runs, sent to the process that runs the engine."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from boxcal.calib.fleet.engine.calls import Told

_listeners: list[Told] = []
"""Where this process reports what its call says; none outside an engine."""


def tell(message: Any) -> None:
    """Say something (small, can be pickled) to the process that runs the engine; said to nobody outside an engine."""
    for listener in _listeners[-1:]:
        listener(message)


@contextmanager
def heard_by(listener: Told) -> Iterator[None]:
    """Give messages that calls report meanwhile to a listener."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.pop()
