"""Recordings in S3, served by moto: range requests counted, and a bucket that may not be read."""

import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("s3fs")
pytest.importorskip("moto")
pytest.importorskip("foxglove_schemas_protobuf")
pytest.importorskip("mcap_ros1")
import fsspec  # type: ignore[import-untyped]
from drive_session import SETTINGS, TARGET, session, solution
from recorded_kinds import events_of
from remote_logs import needed_bytes, with_noise, write_apart

from boxcal.calib.calibrate import calibrate
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import extract
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.stops import find_stops


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    drive = with_noise(session().angles, session().pictures)
    return write_apart(tmp_path_factory.mktemp("s3") / "r07.mcap", events_of(session().angles, drive))


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """moto's server with an empty bucket; the test is skipped, with the reason, where it cannot start."""
    from moto.server import ThreadedMotoServer  # noqa: PLC0415

    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "geheim")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    try:
        server.start()
    except OSError as error:
        pytest.skip(f"moto's server cannot start here: {error}")
    host, port = server.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    _post(f"http://{host}:{port}/moto-api/reset")
    fsspec.get_filesystem_class("s3").clear_instance_cache()  # a client keeps the server that it began with
    fsspec.filesystem("s3").mkdir("logs")
    yield f"http://{host}:{port}"
    server.stop()


def _post(url: str) -> None:
    urllib.request.urlopen(urllib.request.Request(url, method="POST")).close()


def test_of_a_log_in_s3_only_wheels_and_stops_are_asked_for(
    log: Path, s3: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import s3fs  # type: ignore[import-untyped]  # noqa: PLC0415

    fsspec.filesystem("s3").pipe_file("logs/r07.mcap", log.read_bytes())
    asked: list[str] = []
    call = s3fs.S3FileSystem._call_s3

    async def counting(self: object, method: str, *args: object, **kwargs: object) -> object:
        if method == "get_object":
            asked.append(str(kwargs.get("Range")))
        return await call(self, method, *args, **kwargs)

    monkeypatch.setattr(s3fs.S3FileSystem, "_call_s3", counting)
    found = calibrate("s3://logs/r07.mcap", TARGET, settings=SETTINGS)
    right = calibrate(log, TARGET, settings=SETTINGS)
    np.testing.assert_allclose(solution(found), solution(right), rtol=1e-9, atol=1e-9)
    stands = [(stop.t_start_ns, stop.t_end_ns) for stop in find_stops(open_recording(log).wheels)]
    ends = [r.removeprefix("bytes=").split("-") for r in asked]
    fetched = sum(int(last) + 1 - int(first) for first, last in ends)
    assert fetched <= 1.3 * needed_bytes(log, stands)
    assert len(asked) < 30
    assert found.provenance.inputs["r07.mcap"].startswith("etag:")


def test_a_bucket_that_may_not_be_read_or_is_not_there_gets_one_clear_line(
    s3: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from moto import settings  # noqa: PLC0415
    from moto.core.responses import ActionAuthenticatorMixin  # noqa: PLC0415

    with pytest.raises(DetectError, match=r"^r07.mcap: no such file or bucket; check the URL$"):
        extract("s3://nowhere/r07.mcap", TARGET)
    monkeypatch.setattr(settings, "INITIAL_NO_AUTH_ACTION_COUNT", 0.0)  # from here on keys are checked
    monkeypatch.setattr(ActionAuthenticatorMixin, "request_count", 0)
    with pytest.raises(DetectError, match=r"^r07.mcap: access is denied; give credentials") as caught:
        extract("s3://logs/r07.mcap", TARGET)
    assert "geheim" not in str(caught.value)
