"""A look ahead into a file that is read once from front to end."""

from collections.abc import Callable
from typing import BinaryIO

_BLOCK = 1 << 20


class Window:
    """A file read once from front to end, with a look ahead; all that passes is hashed."""

    def __init__(self, file: BinaryIO, size: int, passed: Callable[[bytes], bytes]) -> None:
        self._file, self._passed, self._buffer = file, passed, b""
        self.at, self.size = 0, size
        file.seek(0)
        self._file_at = 0

    @property
    def left(self) -> int:
        """Bytes from here to the end of the file."""
        return self.size - self.at

    def peek(self, count: int) -> bytes:
        """Return the next bytes, fewer at the file's end, without passing them."""
        held = len(self._buffer)
        if held < count:
            more = self._pull(count - held)
            self._buffer = self._buffer + more if held else more
        return self._buffer if len(self._buffer) <= count else self._buffer[:count]

    def skip(self, count: int) -> None:
        """Pass bytes."""
        self.at += count
        held = len(self._buffer)
        self._buffer = self._buffer[count:] if count < held else b""
        count -= held
        while count > 0 and (passed := len(self._pull(min(count, _BLOCK)))):
            count -= passed

    def finish(self) -> None:
        """Hash what was not passed."""
        while self._pull(_BLOCK):
            pass

    def _pull(self, count: int) -> bytes:
        if self._file.tell() != self._file_at:  # others looked elsewhere
            self._file.seek(self._file_at)
        block = self._file.read(count)
        self._file_at += len(block)
        return self._passed(block)
