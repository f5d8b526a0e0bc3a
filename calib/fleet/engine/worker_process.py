"""The life of a worker process: calls arrive through a pipe, and what becomes of them goes back through it."""

import os
import signal
import threading
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from typing import Any

from boxcal.calib.fleet.engine.calls import Call, Done
from boxcal.calib.fleet.engine.here import made
from boxcal.calib.fleet.engine.telling import heard_by
from boxcal.calib.fleet.interrupts import ended_by_sigterm

STARTED, SAID, DONE = "started", "said", "done"
"""What a message through the pipe is: a call began, it said something, it is done."""


def work(pipe: "Connection[Any, Any]") -> None:
    """Make the calls that come through a pipe until it is closed; also if the process at its other end is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process at the other end
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with ended_by_sigterm():
        _make_calls(pipe)


def _make_calls(pipe: "Connection[Any, Any]") -> None:
    while True:
        try:
            call: Call[Any] = pipe.recv()
            pipe.send((STARTED, None))
            with heard_by(lambda message: pipe.send((SAID, message))):
                done = made(call)
            pipe.send((DONE, _without_call(done)))
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return


def _without_call(done: Done[Any]) -> tuple[Any, str, str]:
    """Return what becomes of a call without the call itself, which the other end knows."""
    return done.result, done.lost, done.details


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
