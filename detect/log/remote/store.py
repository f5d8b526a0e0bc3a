"""A store of files behind URLs, by fsspec's clients: look, list, read pieces, write whole; errors in one line."""

import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from boxcal.detect.errors import DetectError
from boxcal.detect.log.remote.urls import url_of
from boxcal.detect.log.safe_text import printable

_CLIENTS = {
    **dict.fromkeys(("s3",), "s3fs"),
    **dict.fromkeys(("gs", "gcs"), "gcsfs"),
    **dict.fromkeys(("az", "abfs", "abfss"), "adlfs"),
    **dict.fromkeys(("http", "https"), "aiohttp"),
}
"""The package that a scheme needs beside fsspec."""
_TAGS = (
    *("ETag", "etag", "md5Hash", "Content-MD5", "Digest"),
    *("mtime", "LastModified", "Last-Modified", "created"),
)
"""Where clients have what changes with a file, the best first."""
_AT_ONCE = 64
"""Small files that are fetched together."""
_DENIED = {401, 403}
_MISSING = {404, 410}
_UNTAGGED = "etag:none:"
"""Begins the identity of a file of which its store says the size alone."""
_ABSENT = ("NoSuchBucket", "NoSuchKey", "does not exist", "Not Found")
_REFUSED = ("AccessDenied", "Forbidden", "InvalidAccessKeyId", "SignatureDoesNotMatch", "Unable to locate credentials")


@dataclass(frozen=True, slots=True, kw_only=True)
class FileState:
    """State of a file: its size, bytes, and what the store says that changes with it, a tag or a time."""

    size: int
    tag: str

    @property
    def identity(self) -> str:
        """The state in one word, for the provenance of what was read."""
        return f"etag:{self.tag}:{self.size}" if self.tag else f"{_UNTAGGED}{self.size}"


def tells_content(identity: str) -> bool:
    """Return whether files of one identity are the same: a hash, or a tag and a size, but not a size alone."""
    return bool(identity) and not identity.startswith(_UNTAGGED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Store:
    """A client and a place in its store.

    Attributes
    ----------
    client
        fsspec's file system.
    place
        What the client calls the place.
    name
        Of the file or folder, for messages.
    """

    client: Any
    place: str
    name: str

    def state(self) -> FileState:
        """Return size and tag of the file as they are now (DetectError if it is not there or may not be read)."""
        with said(self.name):
            self.client.invalidate_cache()
            about = self.client.info(self.place)
        if about.get("type") == "directory" or about.get("size") is None:
            raise DetectError(
                "no file, or a server that does not say its size", source=self.name, remedy="check the URL"
            )
        tag = next((about[k] for k in _TAGS if k in about), "")
        return FileState(size=int(about["size"]), tag=str(tag).strip('"'))

    def is_folder(self) -> bool:
        """Return whether the place is a folder; the web has none, and what cannot be looked at is none."""
        if {"http", "https"} & set(_protocols(self.client)):
            return False
        try:
            return bool(self.client.isdir(self.place))
        except Exception:
            return False

    def exists(self) -> bool:
        """Return whether the file is there (DetectError if the store cannot be reached or does not say)."""
        with said(self.name):
            return bool(self.client.exists(self.place))

    def pieces(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        """Return the bytes of ranges (first, end), all asked for at once."""
        with said(self.name):
            if len(ranges) == 1:
                return [bytes(self.client.cat_file(self.place, start=ranges[0][0], end=ranges[0][1]))]
            starts, ends = [a for a, _ in ranges], [b for _, b in ranges]
            found = self.client.cat_ranges([self.place] * len(ranges), starts, ends, on_error="raise")
            return [bytes(piece) for piece in found]

    def names(self) -> list[str]:
        """Return the names of the files in a folder, sorted."""
        with said(self.name):
            self.client.invalidate_cache()
            return sorted(PurePosixPath(str(p)).name for p in self.client.ls(self.place, detail=False))

    def contents(self, pattern: str) -> Iterator[tuple[str, bytes]]:
        """Yield path below the place, and content, of the files that a pattern names."""
        with said(self.name):
            self.client.invalidate_cache()
            found = self._glob(pattern)
        for k in range(0, len(found), _AT_ONCE):  # not all are held at once
            some = found[k : k + _AT_ONCE]
            with said(self.name):
                contents = self.client.cat(some) if len(some) > 1 else {p: self.client.cat_file(p) for p in some}
            for path, content in contents.items():
                yield _below(path, pattern), bytes(content)

    def matching(self, pattern: str) -> list[str]:
        """Return the paths, below the place, of the files that a pattern names."""
        with said(self.name):
            self.client.invalidate_cache()
            return [_below(path, pattern) for path in self._glob(pattern)]

    def _glob(self, pattern: str) -> list[str]:
        return [str(path) for path in self.client.glob(f"{self.place.rstrip('/')}/{pattern}")]

    def check_writable(self) -> None:
        """Write and remove an empty file (DetectError if that is not allowed)."""
        probe = f"{self.place.rstrip('/')}/.boxcal-{secrets.token_hex(4)}"
        with said(self.name):
            if "file" in _protocols(self.client):
                self.client.makedirs(self.place, exist_ok=True)
            self.client.pipe_file(probe, b"")
            self.client.rm_file(probe)

    def remove(self, name: str) -> None:
        """Remove a file below the place, if it is there."""
        place = f"{self.place.rstrip('/')}/{name}"
        with said(f"{self.name}/{name}"):
            if self.client.exists(place):
                self.client.rm_file(place)

    def put(self, name: str, content: bytes) -> None:
        """Write a file below the place whole or not at all."""
        place = f"{self.place.rstrip('/')}/{name}"
        with said(f"{self.name}/{name}"):
            if "file" in _protocols(self.client):
                aside = f"{place}.part"
                self.client.makedirs(place.rpartition("/")[0], exist_ok=True)
                self.client.pipe_file(aside, content)
                self.client.mv(aside, place)
            else:  # an object appears when all of it has arrived
                self.client.pipe_file(place, content)


def _protocols(client: Any) -> tuple[str, ...]:
    return (client.protocol,) if isinstance(client.protocol, str) else tuple(client.protocol)


def store_of(path: str | Path) -> Store:
    """Return the store that a URL is of (DetectError if a package is missing or the URL is none)."""
    url = url_of(path)
    name = PurePosixPath(str(path)).name
    if url is None:
        raise DetectError("no URL", source=name)
    scheme = url.partition(":")[0]
    try:
        import fsspec  # noqa: PLC0415  (an extra)

        with said(name):
            client, place = fsspec.core.url_to_fs(url)
    except ImportError as error:
        client_package = _CLIENTS.get(scheme, "fsspec")
        raise DetectError(
            f"{scheme}:// needs packages that are not installed",
            source=name,
            remedy=f"pip install 'boxcal[remote]' {client_package}",
        ) from error
    return Store(client=client, place=place, name=name)


def _below(path: str, pattern: str) -> str:
    """Return a path that a pattern named from where the pattern begins."""
    return "/".join(path.split("/")[-1 - pattern.count("/") :])


def put_folder(folder: Path, place: Path, *, last: str, stale: Iterable[str] = ()) -> None:
    """Put the files of a folder to a place behind a URL, each whole, one of them last; remove what is stale there.

    Raises
    ------
    DetectError
        If the place cannot be reached or written.
    """
    store = store_of(place)
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    for name in sorted(files, key=lambda name: (name == last, name)):
        store.put(name, files[name].read_bytes())
    for name in set(stale) - set(files):
        store.remove(name)


def expanded(path: str | Path) -> list[Path]:
    """Return the files that a glob on a URL names, sorted; a URL without a pattern as it is.

    Raises
    ------
    DetectError
        If nothing matches, or the place may not be listed.
    """
    url = url_of(path)
    if url is None or not any(c in url for c in "*["):
        return [Path(path)]
    store = store_of(path)
    with said(store.name):
        found = sorted(store.client.glob(store.place))
    if not found:
        raise DetectError(
            "nothing matches", source=printable(url), remedy="check the pattern, and whether it may be listed"
        )
    scheme = url.partition("://")[0]
    return [Path(f if "://" in f else f"{scheme}://{f}") for f in map(str, found)]


def fetched(path: str | Path, most: int) -> bytes:
    """Return the content of a small file behind a URL (DetectError if it is larger than ``most`` bytes)."""
    store = store_of(path)
    state = store.state()
    if state.size > most:
        raise DetectError(f"{state.size} bytes, at most {most} are read", source=store.name, remedy="check the URL")
    return store.pieces([(0, state.size)])[0] if state.size else b""


@contextmanager
def said(name: str) -> Iterator[None]:
    """Turn what a client raises into one clear line that names the file and holds nothing of the request."""
    try:
        yield
    except (DetectError, ImportError):
        raise
    except Exception as error:
        chain = list(_chain(error))
        text = " ".join(f"{type(e).__name__} {e}" for e in chain)
        statuses = {vars(e)[name] for e in chain for name in ("status", "status_code", "code") if name in vars(e)}
        if (
            any(isinstance(e, PermissionError) for e in chain)
            or statuses & _DENIED
            or any(w in text for w in _REFUSED)
            or "Credentials" in text
        ):
            raise DetectError(
                "access is denied",
                source=name,
                remedy="give credentials that may read and write there in the environment or the client's own files",
            ) from error
        apart = any(isinstance(e, OSError) and not isinstance(e, FileNotFoundError) for e in chain)
        absent = isinstance(error, FileNotFoundError) or any(w in text for w in _ABSENT)
        if statuses & _MISSING or (absent and not apart):
            raise DetectError("no such file or bucket", source=name, remedy="check the URL") from error
        raise DetectError(
            f"cannot be reached ({type(chain[-1]).__name__})", source=name, remedy="check the network and the URL"
        ) from error


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and what caused it."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
