"""The engine of one worker: calls are made in this process, one after another."""

import traceback
from collections.abc import Generator, Iterable
from contextlib import AbstractContextManager

from boxcal.calib.fleet.engine.calls import OUT_OF_MEMORY, Call, Done, T, Told
from boxcal.calib.fleet.engine.telling import heard_by
from boxcal.one_thread import one_thread


class ThisProcess(AbstractContextManager["ThisProcess"]):
    """Calls made where they are asked for: no process has to start, and none can be lost."""

    workers = 1
    sees_files = True

    def __exit__(self, *_: object) -> None:
        return None

    def run(self, calls: Iterable[Call[T]], told: Told | None = None) -> Generator[Done[T], None, None]:
        """Yield what becomes of each call, in their order (see :meth:`boxcal.calib.fleet.engine.calls.Engine.run`)."""
        for call in calls:
            with heard_by(told or _nobody):
                done = made(call)
            yield done


@one_thread()
def made(call: Call[T]) -> Done[T]:
    """Return what becomes of a call that is made here and now, by one thread: then sums are the same everywhere."""
    try:
        return Done(call=call, result=call.function(*call.arguments))
    except MemoryError:
        return Done(call=call, lost=OUT_OF_MEMORY)
    except Exception as error:
        return Done(call=call, lost=f"unexpected {type(error).__name__}: {error}", details=traceback.format_exc())


def _nobody(_: object) -> None:
    return
