"""Ctrl-C held back until the work is at a place where it can stop, and never lost."""

import _thread
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_MOMENT_S = 0.02
"""Seconds in which a call-back should have returned."""


@contextmanager
def interrupts_held() -> Iterator[Callable[[], bool]]:
    """Hold Ctrl-C back; gives a function that tells whether it was pressed meanwhile.

    Without this, Python raises KeyboardInterrupt between any two instructions, those of other people's clean-up
    included. Outside the main thread nothing is held back, for signals do not arrive there; nor where they are ignored.
    """
    pressed = threading.Event()
    if not _arrives():
        yield pressed.is_set
        return

    def note(_number: int, _frame: FrameType | None) -> None:
        pressed.set()

    before = signal.signal(signal.SIGINT, note)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def interrupts_remembered() -> Iterator[Callable[[], None]]:
    """Raise KeyboardInterrupt on Ctrl-C, again where a call-back swallows it; gives a function that raises it if lost.

    In call-backs (of import locks, of compiled code that is loaded) Python prints what is raised and drops it: the
    work would go on as if nothing had been pressed. Here nothing is printed, and the press arrives anew a moment later.
    Outside the main thread nothing is remembered, nor where Ctrl-C is ignored.
    """
    pressed = threading.Event()

    def again() -> None:
        if pressed.is_set():
            raise KeyboardInterrupt

    if not _arrives():
        yield again
        return

    def note(number: int, frame: FrameType | None) -> None:
        pressed.set()
        signal.default_int_handler(number, frame)

    before = signal.signal(signal.SIGINT, note)
    try:
        with _pressed_anew_where_dropped():
            yield again
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _pressed_anew_where_dropped() -> Iterator[None]:
    """Press Ctrl-C again a moment after Python dropped a KeyboardInterrupt, which it does in call-backs."""
    before = sys.unraisablehook
    presses: list[threading.Timer] = []

    def dropped(what: "sys.UnraisableHookArgs") -> None:
        if not isinstance(what.exc_value, KeyboardInterrupt):
            before(what)
            return
        presses.append(threading.Timer(_MOMENT_S, _thread.interrupt_main))
        presses[-1].daemon = True
        presses[-1].start()

    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = before
        for press in presses:
            press.cancel()
            press.join()


def _arrives() -> bool:
    """Tell whether Ctrl-C arrives here: in the main thread, unless it is ignored as in a shell's background jobs."""
    return threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) != signal.SIG_IGN


@contextmanager
def children_without_interrupts() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach: it is blocked while they start, and they inherit that."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
