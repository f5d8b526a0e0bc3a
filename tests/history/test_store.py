"""The store: what is put is read back, nothing is there twice, every fault is one line, in SQLite and PostgreSQL."""

import sqlite3
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sqlalchemy")
pytest.importorskip("alembic")

import sqlalchemy as sa
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext

from boxcal.calib.errors import CalibError
from boxcal.calib.history.session import Session
from boxcal.calib.history_store.connection import StoreError, _told, alembic_config, open_store
from boxcal.calib.history_store.place import store_url
from boxcal.calib.history_store.record import check_store
from boxcal.calib.history_store.sessions import count, forget, put, read, set_time
from boxcal.calib.history_store.tables import VERSION_TABLE, metadata
from boxcal.calib.simulate.years import Years, simulated_years


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """An empty store."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path}/fleet.sqlite"
        return
    where = request.getfixturevalue("postgres")
    yield where
    engine = sa.create_engine(where)
    with engine.begin() as connection:
        for table in ("boxcal_session", "boxcal_robot", VERSION_TABLE):
            connection.execute(sa.text(f"drop table if exists {table}"))
    engine.dispose()


@pytest.fixture(scope="module")
def sessions() -> list[Session]:
    return simulated_years(Years(robots=3, sessions=4), np.random.default_rng(0))


def test_what_is_put_is_read_back(url: str, sessions: list[Session]) -> None:
    open_ended = sessions[0].covariance.copy()
    open_ended[3, :] = open_ended[:, 3] = np.nan
    open_ended[3, 3] = np.inf
    given = [replace(sessions[0], covariance=open_ended, hardware="rev Ä", notes=("odd",)), *sessions[1:]]
    with open_store(url) as connection:
        put(connection, given)
    with open_store(url) as connection:
        found = read(connection)
    assert [(s.robot, s.key) for s in found] == sorted((s.robot, s.key) for s in given)
    by_key = {s.key: s for s in found}
    for s in given:
        there = by_key[s.key]
        np.testing.assert_array_equal(there.covariance, s.covariance)
        np.testing.assert_allclose(there.T_body_cam, s.T_body_cam, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(there.wheels, s.wheels)
        assert (there.t_ns, there.hardware, there.notes, there.verdict) == (s.t_ns, s.hardware, s.notes, s.verdict)


def test_the_same_drive_again_is_no_second_session(url: str, sessions: list[Session]) -> None:
    again = replace(sessions[2], wheels=sessions[2].wheels * 1.001, calibrated="2026-02-01T00:00:00+00:00")
    older = replace(again, wheels=again.wheels * 2, calibrated="2020-01-01T00:00:00+00:00")
    for new in (sessions, sessions, [again], [older]):
        with open_store(url) as connection:
            put(connection, new)
    with open_store(url) as connection:
        assert count(connection) == len(sessions)
        found = next(s for s in read(connection, [again.robot]) if s.key == again.key)
    np.testing.assert_array_equal(found.wheels, again.wheels)


def test_two_runs_at_once_lose_nothing(url: str, sessions: list[Session]) -> None:
    problems: list[BaseException] = []

    def one() -> None:
        try:
            with open_store(url) as connection:
                put(connection, sessions)
        except BaseException as error:  # told below
            problems.append(error)

    runs = [threading.Thread(target=one) for _ in range(4)]
    for run in runs:
        run.start()
    for run in runs:
        run.join()
    assert problems == []
    with open_store(url) as connection:
        assert count(connection) == len(sessions)


def test_a_fault_in_the_middle_leaves_nothing_half_written(url: str, sessions: list[Session]) -> None:
    def spoilt() -> None:
        with open_store(url) as connection:
            put(connection, sessions)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        spoilt()
    with open_store(url) as connection:
        assert count(connection) == 0


def test_migrations_go_up_and_down_and_end_at_the_tables(url: str) -> None:
    with open_store(url) as connection:
        context = MigrationContext.configure(connection, opts={"version_table": VERSION_TABLE})
        assert compare_metadata(context, metadata) == []
        command.downgrade(alembic_config(connection), "base")
        assert set(sa.inspect(connection).get_table_names()) <= {VERSION_TABLE}
        command.upgrade(alembic_config(connection), "head")
        assert compare_metadata(context, metadata) == []


def test_a_store_of_a_newer_version_is_left_alone(url: str) -> None:
    with open_store(url) as connection:
        connection.execute(sa.text(f"update {VERSION_TABLE} set version_num = '9999'"))
    with pytest.raises(StoreError, match=r"made by a newer version of boxcal .*9999.*; update boxcal") as caught:
        check_store(url)
    assert not caught.value.passing
    engine = sa.create_engine(url)
    with engine.begin() as connection:
        assert connection.execute(sa.text(f"select version_num from {VERSION_TABLE}")).scalar_one() == "9999"
    engine.dispose()


def test_a_clock_that_runs_backwards_is_said_and_can_be_set_right(url: str, sessions: list[Session]) -> None:
    own = [s for s in sessions if s.robot == "r0000"]
    late = replace(own[0], key="late", t_ns=own[0].t_ns - 10**15, calibrated="2026-06-01T00:00:00+00:00")
    with open_store(url) as connection:
        assert put(connection, sessions) == []
        lines = put(connection, [late])
        assert len(lines) == 1
        assert lines[0].startswith(f"r0000: this drive is dated {late.date}, before one")
        assert put(connection, [late]) == []
        set_time(connection, "r0000", "lat", own[-1].t_ns + 10**15)
        put(connection, [late])  # calibrated again: the day that a user gave stays
        assert read(connection, ["r0000"])[-1].key == "late"
        with pytest.raises(CalibError, match="no drive of r0000 begin with 'zz'; robot-history show r0000"):
            set_time(connection, "r0000", "zz", 0)


def test_a_drive_or_a_robot_can_be_forgotten(url: str, sessions: list[Session]) -> None:
    with open_store(url) as connection:
        put(connection, sessions)
        assert forget(connection, "r0001", "1-2") == 1
        assert [s.key for s in read(connection, ["r0001"])] == ["1-0", "1-1", "1-3"]
        assert forget(connection, "r0001") == 3
        with pytest.raises(CalibError, match="no robot r0001 in the store"):
            forget(connection, "r0001")
        assert count(connection) == len(sessions) - 4


def test_a_locked_store_is_said_in_one_line(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/fleet.sqlite"
    with open_store(url):
        pass
    other = sqlite3.connect(tmp_path / "fleet.sqlite", isolation_level=None)
    other.execute("begin exclusive")
    said = r"fleet.sqlite: locked by somebody else; try again"
    with pytest.raises(StoreError, match=said) as caught, open_store(url, patience_s=0.1):
        pass
    assert caught.value.passing
    other.close()


def test_a_locked_table_of_postgresql_is_said_in_one_line(postgres: str, sessions: list[Session]) -> None:
    with open_store(postgres) as connection:
        put(connection, sessions)
    engine = sa.create_engine(postgres)
    with engine.begin() as other:
        other.execute(sa.text("lock table boxcal_session in access exclusive mode"))
        said = r"^postgresql\+psycopg://fleet@127.0.0.1:\d+/postgres: locked"
        with pytest.raises(StoreError, match=said) as caught, open_store(postgres, patience_s=0.1) as connection:
            put(connection, sessions)
    assert caught.value.passing
    assert "\n" not in str(caught.value)
    with engine.begin() as other:
        for table in ("boxcal_session", "boxcal_robot", VERSION_TABLE):
            other.execute(sa.text(f"drop table {table}"))
    engine.dispose()


def test_a_full_disk_is_said(tmp_path: Path, sessions: list[Session]) -> None:
    url = f"sqlite:///{tmp_path}/fleet.sqlite"
    with open_store(url) as connection:
        pages = connection.exec_driver_sql("pragma page_count").scalar_one()

    def fill() -> None:
        with open_store(url) as connection:
            connection.exec_driver_sql(f"pragma max_page_count = {pages}")
            put(connection, [replace(s, key=f"{s.key}{i}") for s in sessions for i in range(20)])

    with pytest.raises(StoreError, match=r"fleet.sqlite: its disk is full; make room") as caught:
        fill()
    assert caught.value.passing
    with open_store(url) as connection:
        assert count(connection) == 0


@pytest.mark.parametrize(
    ("url", "message", "passing"),
    [
        (
            "postgresql+psycopg://u:geheim@127.0.0.1:1/x",
            r"^postgresql\+psycopg://u@127.0.0.1:1/x: cannot be reached",
            True,
        ),
        ("foo://host/x", r"^foo://host/x: no database of that kind is known", False),
        ("mysql+nodriver://host/x", r"no database of that kind is known", False),
        ("sqlite:////no/such/folder/x.sqlite", r"^/no/such/folder/x.sqlite: its folder does not exist", False),
        ("postgresql+psycopg://[", r"no URL of a database|cannot be reached", None),
    ],
)
def test_a_store_that_is_none_is_said_without_its_password(url: str, message: str, passing: bool | None) -> None:
    if url.startswith("postgresql"):
        pytest.importorskip("psycopg")
    with pytest.raises(StoreError, match=message) as caught, open_store(url):
        pass
    assert "geheim" not in str(caught.value)
    assert "\n" not in str(caught.value)
    assert passing is None or caught.value.passing is passing


@pytest.mark.parametrize(
    ("said", "message", "passing"),
    [
        ('FATAL:  password authentication failed for user "fleet"', "refuses who asks", False),
        ('FATAL:  no pg_hba.conf entry for host "10.0.0.7", user "fleet"', "refuses who asks", False),
        ("fe_sendauth: no password supplied", "refuses who asks", False),
        ("FATAL:  sorry, too many clients already", "cannot be reached", True),
        ("Connection refused. Is the server running on that host?", "cannot be reached", True),
    ],
)
def test_who_is_not_let_in_is_not_told_to_try_again(said: str, message: str, passing: bool) -> None:
    sa = pytest.importorskip("sqlalchemy")
    words = f'connection failed: connection to server at "10.0.0.8", port 5432 failed: {said}'
    error = _told("postgresql+psycopg://fleet@10.0.0.8/x", sa.exc.OperationalError("", {}, OSError(words)))
    assert message in str(error)
    assert error.passing is passing


def test_a_database_that_is_not_there_is_no_passing_trouble(postgres: str) -> None:
    nowhere = postgres.removesuffix("postgres") + "nowhere"
    with pytest.raises(StoreError, match=r'refuses who asks.*database "nowhere" does not exist') as caught:
        open_store(nowhere).__enter__()
    assert not caught.value.passing


def test_a_file_that_is_no_database_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("some notes of mine, long enough to have a head that is no database's" * 20)
    with pytest.raises(StoreError, match=r"notes.txt: no database, or a damaged one"), open_store(f"sqlite:///{path}"):
        pass
    assert path.read_text().startswith("some notes")


def test_a_password_on_the_command_line_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    urls = ("postgresql://u:geheim@h/x", "postgresql://u:ge/heim@h/x", "postgresql://h/x?user=u&password=geheim")
    for given in urls:
        with pytest.raises(CalibError, match="--store holds a password, and the command line is written") as caught:
            store_url(given)
        assert "geheim" not in str(caught.value)
    monkeypatch.setenv("BOXCAL_STORE", "postgresql://u:geheim@h/x")
    assert store_url(None) == "postgresql://u:geheim@h/x"
    assert store_url("fleet.sqlite") == "sqlite:///fleet.sqlite"
    monkeypatch.delenv("BOXCAL_STORE")
    assert store_url(None) is None
