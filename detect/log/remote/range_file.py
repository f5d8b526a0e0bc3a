"""A file behind a URL that reads like one on disk: by ranges, few and large, each fetched once."""

import tempfile
import weakref
from bisect import bisect_right
from collections.abc import Iterable
from itertools import pairwise
from typing import IO

from boxcal.detect.errors import DetectError
from boxcal.detect.log.remote.store import Store

_FIRST, _LARGEST = 32 << 10, 8 << 20
"""Bytes that a read in sequence asks for: doubled from the first to the largest."""
_AT_ONCE = 32 << 20
"""Bytes that are asked for at once, in ranges side by side."""
_GAPS = 0.15
"""Gaps between wanted ranges are fetched along while they are less than this part of what is wanted."""
_IN_MEMORY = 32 << 20
_MOST_WHOLE = 1 << 30
"""Largest file of a server that gives no ranges."""


class RangeFile:
    """A remote file, open for reading and seeking.

    Attributes
    ----------
    state
        Size and tag when it was opened.
    requests, fetched
        How many ranges were asked for, and their bytes.
    """

    def __init__(self, store: Store) -> None:
        self._store, self.state = store, store.state()
        self.requests = self.fetched = 0
        self._at, self._ahead = 0, _FIRST
        self._block: tuple[int, bytes] = (0, b"")
        self._starts: list[int] = []
        self._kept: list[tuple[int, int, int]] = []
        self._spool: IO[bytes] | None = None
        self._whole = False

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a place: from the start, from here (1), or from the end (2)."""
        self._at = max(offset + (self._at if whence == 1 else self.state.size if whence == 2 else 0), 0)
        return self._at

    def tell(self) -> int:
        """Return the place."""
        return self._at

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes, fewer at the file's end; reading in sequence fetches more and more ahead."""
        end = self.state.size if size < 0 else min(self._at + size, self.state.size)
        parts: list[bytes] = []
        while self._at < end:
            piece = self._held(self._at, end)
            if not piece:
                self._fetch_block(end)
                continue
            parts.append(piece)
            self._at += len(piece)
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def prefetch(self, ranges: Iterable[tuple[int, int]]) -> None:
        """Fetch ranges (first, end) that will be read and are not kept yet: joined where little lies between."""
        within = [(a, min(b, self.state.size)) for a, b in ranges if a < self.state.size]
        for batch in _batches(_joined([(a, b) for a, b in within if not self._keeps(a, b)])):
            for (start, _), content in zip(batch, self._asked(batch), strict=True):
                self._keep(start, content)

    def refuse_change(self) -> None:
        """Refuse a file that is no longer as it was when it was opened (DetectError)."""
        if self._store.state() != self.state:
            raise _changed(self._store.name)

    def is_now(self, store: Store) -> bool:
        """Return whether this is the file at a store's place, as it is now."""
        return store.place == self._store.place and store.client is self._store.client and store.state() == self.state

    def close(self) -> None:
        """Do nothing: what was fetched stays for whoever opens the file again, until another is opened."""

    def forget(self) -> None:
        """Forget what was fetched."""
        if self._spool is not None:
            self._spool.close()
            self._spool = None
        self._block, self._kept, self._starts = (0, b""), [], []
        self._whole = False

    def _keeps(self, start: int, end: int) -> bool:
        """Return whether all of a range is kept."""
        at = start
        while at < end:
            k = bisect_right(self._starts, at) - 1
            if k < 0 or sum(self._kept[k][:2]) <= at:
                return False
            at = sum(self._kept[k][:2])
        return True

    def _held(self, at: int, end: int) -> bytes:
        """Return what is held from a place on, nothing if nothing is."""
        start, block = self._block
        if start <= at < start + len(block):
            return block[at - start : end - start]
        k = bisect_right(self._starts, at) - 1
        if k >= 0 and self._spool is not None:
            first, length, where = self._kept[k]
            if at < first + length:
                self._spool.seek(where + at - first)
                return self._spool.read(min(end, first + length) - at)
        return b""

    def _fetch_block(self, end: int) -> None:
        start, block = self._block
        follows = bool(block) and self._at == start + len(block)
        self._ahead = min(2 * self._ahead, _LARGEST) if follows else _FIRST
        stop = min(max(end, self._at + self._ahead), self.state.size)
        k = bisect_right(self._starts, self._at)
        if k < len(self._starts):
            stop = max(min(stop, self._starts[k]), self._at + 1)
        (content,) = self._asked([(self._at, stop)])
        self._block = (self._at, content)

    def _asked(self, ranges: list[tuple[int, int]]) -> list[bytes]:
        """Return ranges from the store, as long as was asked for; none is asked for once the whole file is held."""
        if self._whole:
            return [self._held(start, end) for start, end in ranges]
        found = self._store.pieces(ranges)
        self.requests += len(ranges)
        self.fetched += sum(map(len, found))
        out = []
        for (start, end), piece in zip(ranges, found, strict=True):
            if len(piece) == end - start:
                out.append(piece)
            elif len(piece) == self.state.size <= _MOST_WHOLE:  # a server without ranges gives all of it
                self._starts, self._kept, self._whole = [], [], False
                self._keep(0, piece)
                self._whole = True
                out.append(piece[start:end])
            else:
                raise _changed(self._store.name)
        return out

    def _keep(self, start: int, content: bytes) -> None:
        if self._whole:
            return
        if self._spool is None:
            self._spool = tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY)  # noqa: SIM115  (closed with the file)
            weakref.finalize(self, self._spool.close)
        where = self._spool.seek(0, 2)
        self._spool.write(content)
        k = bisect_right(self._starts, start)
        self._starts.insert(k, start)
        self._kept.insert(k, (start, len(content), where))


_last: list[RangeFile] = []
"""The remote file that this process opened last."""


def opened_again(store: Store) -> RangeFile:
    """Return a remote file, with what was fetched of it if it was the last that was opened and did not change."""
    if _last and _last[0].is_now(store):
        _last[0].seek(0)
        return _last[0]
    file = RangeFile(store)
    for before in _last:
        before.forget()
    _last[:] = [file]
    return file


def _changed(name: str) -> DetectError:
    return DetectError("changed while it was read", source=name, remedy="let its upload finish and try again")


def _joined(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return ranges joined over the smallest gaps, as long as these stay a small part of what is wanted."""
    out: list[tuple[int, int]] = []
    for start, end in sorted(ranges):
        if out and start <= out[-1][1]:
            out[-1] = (out[-1][0], max(end, out[-1][1]))
        else:
            out.append((start, end))
    left = _GAPS * sum(end - start for start, end in out)
    gaps = sorted((b[0] - a[1], k) for k, (a, b) in enumerate(pairwise(out)))
    over: set[int] = set()
    for gap, k in gaps:
        left -= gap
        if left < 0:
            break
        over.add(k)
    joined: list[tuple[int, int]] = []
    for k, (start, end) in enumerate(out):
        if joined and k - 1 in over:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return [(at, min(at + _LARGEST, end)) for start, end in joined for at in range(start, end, _LARGEST)]


def _batches(ranges: list[tuple[int, int]]) -> Iterable[list[tuple[int, int]]]:
    batch: list[tuple[int, int]] = []
    for piece in ranges:
        if batch and sum(b - a for a, b in batch) + piece[1] - piece[0] > _AT_ONCE:
            yield batch
            batch = []
        batch.append(piece)
    if batch:
        yield batch
