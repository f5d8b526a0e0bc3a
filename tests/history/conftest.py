"""PostgreSQL, started by the tests on a free port as a user without rights."""

import os
import pwd
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest


def _binary(name: str) -> str | None:
    if found := shutil.which(name):
        return found
    places = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return str(places[-1]) if places else None


@pytest.fixture(scope="session")
def postgres(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """URL of a database of a server of our own; the test is skipped, with the reason, where it cannot start."""
    pytest.importorskip("psycopg")
    initdb, server = _binary("initdb"), _binary("postgres")
    if initdb is None or server is None:
        pytest.skip("PostgreSQL is not here: apt-get install postgresql")
    folder = Path(f"/tmp/boxcal-pg-{os.getpid()}")
    folder.mkdir(mode=0o700)
    user: dict[str, object] = {}
    if os.getuid() == 0:  # initdb refuses root
        try:
            nobody = pwd.getpwnam("nobody")
        except KeyError:
            pytest.skip("PostgreSQL refuses to run as root, and there is no user nobody")
        os.chown(folder, nobody.pw_uid, nobody.pw_gid)
        user = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
    log = tmp_path_factory.mktemp("postgres") / "log"
    port = _free_port()
    running = None
    try:
        made = subprocess.run(
            [
                initdb,
                "-D",
                str(folder / "data"),
                "-U",
                "fleet",
                "--auth=trust",
                "--no-sync",
                "-E",
                "UTF8",
                "--locale=C",
            ],
            capture_output=True,
            text=True,
            check=False,
            cwd="/",
            **user,  # type: ignore[call-overload]
        )
        if made.returncode:
            pytest.skip(f"PostgreSQL cannot start here: {made.stderr.strip()[-200:]}")
        with log.open("wb") as out:
            running = subprocess.Popen(
                [server, "-D", str(folder / "data"), "-p", str(port), "-h", "127.0.0.1", "-k", str(folder), "-F"],
                stdout=out,
                stderr=out,
                cwd="/",
                **user,  # type: ignore[call-overload]
            )
        if not _answers(port, running):
            pytest.skip(f"PostgreSQL cannot start here: {log.read_text(errors='replace')[-300:]}")
        yield f"postgresql+psycopg://fleet@127.0.0.1:{port}/postgres"
    finally:
        if running is not None:
            running.terminate()
            running.wait(20)
        shutil.rmtree(folder, ignore_errors=True)


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def _answers(port: int, running: "subprocess.Popen[bytes]") -> bool:
    import time  # noqa: PLC0415

    import psycopg  # noqa: PLC0415

    end = time.monotonic() + 30
    while time.monotonic() < end and running.poll() is None:
        try:
            psycopg.connect(f"host=127.0.0.1 port={port} user=fleet dbname=postgres", connect_timeout=2).close()
        except psycopg.OperationalError:
            time.sleep(0.1)
        else:
            return True
    return False
