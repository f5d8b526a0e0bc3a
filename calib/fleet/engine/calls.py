"""Calls for an engine, what becomes of them, and what every engine can do."""

from collections.abc import Callable, Generator, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

T = TypeVar("T")

OUT_OF_MEMORY = "ran out of memory"
"""What is said of a call whose process had no memory left; it is made once more, as is one whose process died."""

Told = Callable[[Any], None]
"""Receives what calls report of themselves while they run; in the process that runs the engine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Call(Generic[T]):
    """One call to be made somewhere, which may be made again if the process that made it is lost.

    Attributes
    ----------
    key
        Its name, one of its own within a run: of the robot, as a rule.
    function
        A function of a module, so that another process finds it.
    arguments
        Its arguments; all can be pickled, as what it returns.
    """

    key: str
    function: Callable[..., T]
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Done(Generic[T]):
    """Outcome of a call.

    Attributes
    ----------
    call
        The call.
    result
        What it returned; None if nothing came back.
    lost
        Why nothing came back, for messages: the process died twice, took too long twice, or the function raised
        something. Empty if all went well.
    details
        Traceback of what the function raised; else empty.
    """

    call: Call[T]
    result: T | None = None
    lost: str = ""
    details: str = ""


class Engine(AbstractContextManager["Engine"], Protocol):
    """Somewhere to make calls; left as a context, everything that it started is ended."""

    @property
    def workers(self) -> int:
        """Number of calls that are made at once, as far as is known."""

    @property
    def sees_files(self) -> bool:
        """Whether calls see the files of this machine, as those in its own processes do."""

    def run(self, calls: Iterable[Call[T]], told: Told | None = None) -> Generator[Done[T], None, None]:
        """Yield what becomes of each call, as they finish; closing the generator cancels the others.

        Calls are taken from their iterable when there is somewhere to make them, and results are not kept, so neither
        need fit into memory together. An engine runs one set of calls at a time, any number one after another: sums
        over many robots are made by calls that sum over a part each, whose results are summed by further calls.

        Raises
        ------
        CalibError
            If the engine itself is lost, and with it the calls that are not done.
        KeyboardInterrupt
            If Ctrl-C was pressed, between two results.
        """
