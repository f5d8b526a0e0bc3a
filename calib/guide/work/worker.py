"""One thread that does what takes long, one task at a time; the session asks now and then whether it is done."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any


class Worker:
    """Runs one task at a time.

    Attributes
    ----------
    name
        Of the task that runs or was just finished; empty without one.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="worker")
        self._future: Future[Any] | None = None
        self.name = ""

    @property
    def idle(self) -> bool:
        """Whether a task can be given."""
        return self._future is None

    def begin(self, name: str, task: Callable[[], Any]) -> None:
        """Begin a task; only while idle."""
        self.name, self._future = name, self._pool.submit(task)

    def finished(self) -> tuple[str, Any] | None:
        """Return name and result of a task that is done (its exception is raised here), None if none is."""
        if self._future is None or not self._future.done():
            return None
        future, self._future = self._future, None
        return self.name, future.result()

    def close(self) -> None:
        """Wait for the task that runs, and end the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)
