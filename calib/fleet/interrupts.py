"""Ctrl-C held back until the work is at a place where it can stop, and neither it nor SIGTERM ever lost."""

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
    """Hold Ctrl-C back; gives a function that says whether it was pressed meanwhile.

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
        with _sent_anew_where_dropped(signal.SIGINT, KeyboardInterrupt):
            yield again
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """Raise SystemExit on SIGTERM, so that half-written files are put away; again where a call-back swallows it."""

    def end(_number: int, _frame: FrameType | None) -> None:
        sys.exit(1)

    before = signal.signal(signal.SIGTERM, end)
    try:
        with _sent_anew_where_dropped(signal.SIGTERM, SystemExit):
            yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _sent_anew_where_dropped(number: signal.Signals, raised: type[BaseException]) -> Iterator[None]:
    """Send a signal again a moment after Python dropped what its handler raised, which it does in call-backs."""
    before = sys.unraisablehook
    sent: list[threading.Timer] = []

    def dropped(what: "sys.UnraisableHookArgs") -> None:
        if not isinstance(what.exc_value, raised):
            before(what)
            return
        while True:  # a signal that was sent before may come here, where it would be dropped like the others
            timer = threading.Timer(_MOMENT_S, signal.raise_signal, [number])
            timer.daemon = True
            try:
                timer.start()
                sent.append(timer)
            except raised:
                timer.cancel()
            else:
                return

    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = before
        for timer in sent:
            timer.cancel()
            timer.join()


def _arrives() -> bool:
    """Return whether Ctrl-C arrives here: in the main thread, unless it is ignored as in a shell's background jobs."""
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
