"""Recordings behind URLs: read in place, in few requests, with the calibration of the same file on disk."""

import functools
import http.server
import re
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

pytest.importorskip("fsspec")
pytest.importorskip("foxglove_schemas_protobuf")
pytest.importorskip("mcap_ros1")
import fsspec  # type: ignore[import-untyped]
from drive_session import SETTINGS, TARGET, session, solution
from recorded_kinds import KINDS, Event, events_of
from remote_logs import filmed, needed_bytes, with_noise, write_apart

from boxcal.calib.calibrate import calibrate
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import extract
from boxcal.detect.log.containers.mcap import McapFile
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.opener import open_container, robot_name_of
from boxcal.detect.log.remote.range_file import RangeFile
from boxcal.detect.log.remote.store import Store, expanded, store_of
from boxcal.detect.log.remote.urls import url_of
from boxcal.detect.stops import find_stops


@pytest.fixture(scope="module")
def drive() -> list[Event]:
    return events_of(session().angles, with_noise(session().angles, session().pictures))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, drive: list[Event]) -> Path:
    path = tmp_path_factory.mktemp("logs")
    write_apart(path / "r07.mcap", drive)
    still = events_of(session().angles, session().pictures)
    KINDS["mcap folder"](path / "r08", still)
    KINDS["split mcap folder"](path / "r09", still)
    KINDS["sqlite3 folder"](path / "r10", still)
    KINDS["mcap.zst"](path / "r11", still)
    KINDS["ROS 1 bag"](path / "r12", still)
    return path


@pytest.fixture
def memory(folder: Path) -> Iterator[str]:
    client = fsspec.filesystem("memory")
    for path in folder.rglob("*"):
        if path.is_file():
            client.pipe_file(f"/bucket/{path.relative_to(folder)}", path.read_bytes())
    yield "memory://bucket"
    client.rm("/bucket", recursive=True)


def _stands(folder: Path) -> list[tuple[int, int]]:
    wheels = open_recording(folder / "r07.mcap").wheels
    return [(stop.t_start_ns, stop.t_end_ns) for stop in find_stops(wheels)]


@functools.cache
def _from_disk(folder: Path) -> Calibration:
    return calibrate(folder / "r07.mcap", TARGET, settings=SETTINGS)


def test_of_an_indexed_log_only_wheels_and_stops_are_fetched(folder: Path, memory: str) -> None:
    path = folder / "r07.mcap"
    found = open_recording(Path(f"{memory}/r07.mcap"))
    frames = dict(found.read_frames(range(found.frame_t_ns.size)))
    container = found.source.container
    assert isinstance(container, McapFile)
    remote = container._file
    assert isinstance(remote, RangeFile)
    right = open_recording(path)
    np.testing.assert_array_equal(found.wheels.phi_R, right.wheels.phi_R)
    for start, end in _stands(folder):
        for t, image in right.read_frames(right.frames_between(start, end)):
            np.testing.assert_array_equal(frames[t], image)
    needed = needed_bytes(path, _stands(folder))
    assert needed < 0.5 * path.stat().st_size
    assert remote.fetched <= 1.3 * needed
    assert remote.fetched > 128_000 * remote.requests
    assert not found.notes
    once = remote.fetched
    open_recording(Path(f"{memory}/r07.mcap"))
    assert remote.fetched == once


def test_where_clocks_are_compared_by_pictures_all_images_are_fetched(tmp_path: Path) -> None:
    """The camera is 1 s ahead and times of recording are copies of stamps: images of the stands show the drive."""
    long = session(16)
    ahead = [(t + 1_000_000_000, picture) for t, picture in filmed(long.angles, long.pictures)]
    path = write_apart(tmp_path / "late.mcap", events_of(long.angles, ahead))
    fsspec.filesystem("memory").pipe_file("/late.mcap", path.read_bytes())
    right, found = extract(path, TARGET), extract("memory://late.mcap", TARGET)
    fsspec.filesystem("memory").rm("/late.mcap")
    assert found.source.clock_offset == right.source.clock_offset == pytest.approx(1.0, abs=0.1)
    assert len(found.stops) == len(right.stops) > 10
    for a, b in zip(found.stops, right.stops, strict=True):
        np.testing.assert_array_equal(a.uv_px, b.uv_px)


@pytest.mark.parametrize("name", ["r07.mcap", "r08", "r09", "r10", "r11.mcap.zst", "r12.bag"])
def test_a_log_behind_a_url_gives_the_calibration_of_the_file(folder: Path, memory: str, name: str) -> None:
    found = calibrate(f"{memory}/{name}", TARGET, settings=SETTINGS)
    right = _from_disk(folder)
    np.testing.assert_allclose(solution(found), solution(right), rtol=1e-9, atol=1e-9)
    assert (found.robot, found.notes) == (name.partition(".")[0], right.notes)
    (digest,) = [value for key, value in found.provenance.inputs.items() if key != "target"]
    assert digest


class _Handler(http.server.SimpleHTTPRequestHandler):
    """Serves files with ranges, and counts what it sends."""

    sent: ClassVar[list[int]] = []
    ranges: ClassVar[bool] = True

    def log_message(self, *_: object) -> None:
        return

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        if "secret" in self.path:
            self.send_error(403)
            return
        if not path.is_file():
            self.send_error(404)
            return
        content, asked = path.read_bytes(), re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        first, last = (int(asked[1]), min(int(asked[2]), len(content) - 1)) if asked else (0, len(content) - 1)
        if not self.ranges:
            asked, first, last = None, 0, len(content) - 1
        self.send_response(206 if asked else 200)
        self.send_header("ETag", f'"{zlib.crc32(content)}"')
        self.send_header("Content-Length", str(last + 1 - first))
        if self.ranges:
            self.send_header("Accept-Ranges", "bytes")
            self.send_header("Content-Range", f"bytes {first}-{last}/{len(content)}")
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(content[first : last + 1])
            self.sent.append(last + 1 - first)

    do_HEAD = do_GET


@pytest.fixture
def web(folder: Path) -> Iterator[str]:
    """A server on this machine; the test is skipped, with the reason, where none can start."""
    pytest.importorskip("aiohttp")
    try:
        handler = functools.partial(_Handler, directory=str(folder))
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    except OSError as error:
        pytest.skip(f"no server can start here: {error}")
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    _Handler.sent, _Handler.ranges = [], True
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize("ranges", [True, False])
def test_a_web_server_sends_what_is_needed_or_the_whole_file_once(folder: Path, web: str, ranges: bool) -> None:
    _Handler.ranges = ranges
    path = folder / "r07.mcap"
    found = calibrate(f"{web}/r07.mcap", TARGET, settings=SETTINGS)
    np.testing.assert_allclose(solution(found), solution(_from_disk(folder)), rtol=1e-9)
    most = 1.3 * needed_bytes(path, _stands(folder)) if ranges else path.stat().st_size
    assert sum(_Handler.sent) <= most
    assert len(_Handler.sent) < 40


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nothing.mcap", r"^nothing.mcap: no such file or bucket; check the URL$"),
        ("secret.mcap", r"^secret.mcap: access is denied; give credentials"),
    ],
)
def test_what_cannot_be_read_gets_one_clear_line(web: str, name: str, message: str) -> None:
    with pytest.raises(DetectError, match=message):
        extract(f"{web}/{name}", TARGET)


def test_a_server_that_is_not_there_gets_one_clear_line() -> None:
    pytest.importorskip("aiohttp")
    with pytest.raises(DetectError, match=r"^a.mcap: cannot be reached \(\w+\); check the network and the URL$"):
        extract("http://127.0.0.1:9/a.mcap", TARGET)


def test_a_log_that_changes_while_it_is_read_is_said(memory: str, monkeypatch: pytest.MonkeyPatch) -> None:
    client = fsspec.filesystem("memory")
    content = client.cat_file("/bucket/r07.mcap")
    pieces = Store.pieces

    def changing(store: Store, ranges: list[tuple[int, int]]) -> list[bytes]:
        found = pieces(store, ranges)
        client.pipe_file("/bucket/r07.mcap", content[:-1] + b"x")
        return found

    monkeypatch.setattr(Store, "pieces", changing)
    with pytest.raises(DetectError, match=r"^r07.mcap: changed while it was read; let its upload finish"):
        extract(f"{memory}/r07.mcap", TARGET)


@pytest.mark.parametrize(
    "url",
    [
        "https://me:geheim@host/a/r07.mcap",
        "https://geheim@host/r07.mcap",
        "https://host/r07.mcap?X-Amz-Signature=geheim",
        "s3://key:geheim@bucket/r07.mcap",
    ],
)
def test_a_url_with_credentials_is_refused_and_not_repeated(url: str) -> None:
    for path in (url, Path(url)):
        with pytest.raises(DetectError, match=r"^r07.mcap: a URL .* without credentials is needed") as caught:
            open_recording(Path(path))
        assert "geheim" not in str(caught.value)


def test_paths_and_urls_are_told_apart() -> None:
    assert url_of(Path("s3://bucket/robots/r07.mcap")) == "s3://bucket/robots/r07.mcap"
    assert url_of("abfs://logs@account.dfs.core.windows.net/r07.mcap") is not None
    assert url_of(Path("robots/r07.mcap")) is None
    assert url_of(Path("/robots/s3:/r07.mcap")) is None
    assert robot_name_of(Path("s3://bucket/robots/r07.mcap.zst")) == "r07"
    assert robot_name_of(Path("s3://bucket/robots/r08")) == "r08"


def test_a_glob_on_a_url_names_its_files(memory: str) -> None:
    assert expanded(f"{memory}/r0*.mcap") == [Path(f"{memory}/r07.mcap")]
    assert expanded(Path("robots/*.mcap")) == [Path("robots/*.mcap")]
    with pytest.raises(DetectError, match="nothing matches"):
        expanded(f"{memory}/x*.mcap")


def test_a_damaged_indexed_log_uses_what_is_intact(folder: Path, memory: str) -> None:
    content = bytearray((folder / "r07.mcap").read_bytes())
    content[len(content) // 2] ^= 0xFF
    fsspec.filesystem("memory").pipe_file("/bucket/r07.mcap", bytes(content))
    found = open_recording(Path(f"{memory}/r07.mcap"))
    assert found.frame_t_ns.size >= len(session().pictures) - 1
    fsspec.filesystem("memory").pipe_file("/bucket/r07.mcap", bytes(content[: len(content) * 2 // 3]))
    cut = open_recording(Path(f"{memory}/r07.mcap"))
    assert any("truncated" in note for note in cut.notes)


def test_reading_in_sequence_takes_few_large_requests(memory: str) -> None:
    file = RangeFile(store_of(f"{memory}/r07.mcap"))
    content = b"".join(iter(lambda: file.read(10_000), b""))
    assert content == fsspec.filesystem("memory").cat_file("/bucket/r07.mcap")
    assert file.fetched == len(content)
    assert file.requests < 14
    file.prefetch([(5, 10), (3, 7), (10_000_000, 10_000_100)])
    assert (file.seek(4), file.read(3)) == (4, content[4:7])
    assert file.seek(-3, 2) == len(content) - 3
    assert file.read() == content[-3:]
    file.close()
    open_container(Path(f"{memory}/r07.mcap")).close()
