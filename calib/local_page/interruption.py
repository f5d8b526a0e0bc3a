"""Ends a command that serves a page as Ctrl-C does, when a process manager asks it to."""

import signal


def end_on_sigterm() -> None:
    """Take SIGTERM for Ctrl-C: what is open is closed, what was recorded is finished."""
    signal.signal(signal.SIGTERM, _interrupt)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt
