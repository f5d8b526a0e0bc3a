"""Opening a store: migrated to this version's tables, every fault in one line, no password in any."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from boxcal.calib.errors import CalibError

PATIENCE_S = 30
"""Seconds that a locked store is waited for."""
_MIGRATION_LOCK = 6_027_013
"""Number of the lock under which PostgreSQL's tables are made: two runs may be the first."""
_LOCKED = ("locked", "lock timeout", "deadlock")
_REFUSED = re.compile(
    "authentication failed|no password supplied|access denied|not permitted to log in|no pg_hba.conf entry"
    '|unknown database|(database|role) "[^"]*" does not exist'
)
"""What a server says to somebody whom it will not let in later either."""
_FULL = ("disk is full", "no space left", "disk full")


class StoreError(CalibError):
    """A store that cannot be used.

    Attributes
    ----------
    passing
        Whether the same command may work later: the store is locked, or down.
    """

    passing = False


@contextmanager
def open_store(url: str, *, patience_s: float = PATIENCE_S) -> Iterator[Any]:
    """Give a connection to a store in a transaction, its tables brought to this version first.

    What is written is kept if the block ends well, else nothing of it.

    Parameters
    ----------
    url
        As :func:`boxcal.calib.history_store.place.store_url` returns it.
    patience_s : s
        How long to wait for a store that is locked.

    Raises
    ------
    StoreError
        If the extra ``store`` is missing, the URL is none, or the store is down, locked, full, of a newer version of
        boxcal, or no database.
    """
    try:
        import alembic  # noqa: F401, PLC0415  an extra, as the next
        import sqlalchemy.exc as faults  # noqa: PLC0415
    except ImportError as error:
        raise StoreError("a store needs SQLAlchemy and Alembic", remedy="pip install 'boxcal[store]'") from error
    try:
        engine = _engine(url, patience_s)
    except faults.NoSuchModuleError as error:
        raise _error(url, "no database of that kind is known", remedy="check the URL's beginning") from error
    except ModuleNotFoundError as error:
        raise _error(url, f"its driver {error.name} is not installed", remedy=f"pip install {error.name}") from error
    except (faults.ArgumentError, ValueError) as error:
        if isinstance(error, CalibError):
            raise
        raise _error(url, "no URL of a database", needed="such as postgresql+psycopg://host/name") from error
    try:
        with engine.begin() as connection:
            _bring_up_to_date(connection, _name(url))
            yield connection
    except faults.DBAPIError as error:
        raise _told(url, error) from error
    finally:
        engine.dispose()


def _engine(url: str, patience_s: float) -> Any:
    import sqlalchemy as sa  # noqa: PLC0415
    from sqlalchemy.pool import NullPool  # noqa: PLC0415

    parsed = sa.make_url(url)
    arguments: dict[str, Any] = {}
    if parsed.get_backend_name() == "sqlite":
        arguments["timeout"] = patience_s
        if parsed.database and not Path(parsed.database).parent.is_dir():
            raise _error(url, "its folder does not exist", remedy="make it, or correct the path")
    if parsed.get_backend_name() == "postgresql":
        arguments["connect_timeout"] = 10
        arguments["options"] = f"-c lock_timeout={int(patience_s * 1000)}"
    engine = sa.create_engine(parsed, connect_args=arguments, poolclass=NullPool)
    if parsed.get_backend_name() == "sqlite":
        # The driver would begin a transaction only before a change: whoever opens a store may write, and waits here.
        sa.event.listen(engine, "connect", lambda dbapi, _: setattr(dbapi, "isolation_level", None))
        sa.event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE"))
    return engine


def alembic_config(connection: Any) -> Any:
    """Return Alembic's configuration for this package's migrations on a connection."""
    from alembic.config import Config  # noqa: PLC0415

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations").replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def _bring_up_to_date(connection: Any, name: str) -> None:
    import sqlalchemy as sa  # noqa: PLC0415
    from alembic import command  # noqa: PLC0415
    from alembic.runtime.migration import MigrationContext  # noqa: PLC0415
    from alembic.script import ScriptDirectory  # noqa: PLC0415

    from boxcal.calib.history_store.tables import VERSION_TABLE  # noqa: PLC0415

    config = alembic_config(connection)
    script = ScriptDirectory.from_config(config)
    context = MigrationContext.configure(connection, opts={"version_table": VERSION_TABLE})
    found = context.get_current_revision()
    if found == script.get_current_head():
        return
    if found is not None and all(found != revision.revision for revision in script.walk_revisions()):
        raise StoreError(
            f"made by a newer version of boxcal (its tables are of {found}, this version knows up to "
            f"{script.get_current_head()})",
            source=name,
            remedy="update boxcal, or name another store",
        )
    if connection.dialect.name == "postgresql":
        connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_MIGRATION_LOCK)))
    command.upgrade(config, "head")


def _name(url: str) -> str:
    """Return a store as messages name it: without password."""
    import sqlalchemy as sa  # noqa: PLC0415
    from sqlalchemy.exc import ArgumentError  # noqa: PLC0415

    try:
        parsed = sa.make_url(url)
    except (ArgumentError, ValueError):
        return "the store"
    if parsed.get_backend_name() == "sqlite":
        return parsed.database or "a store in memory"
    return sa.URL.create(
        parsed.drivername, username=parsed.username, host=parsed.host, port=parsed.port, database=parsed.database
    ).render_as_string()


def _error(url: str, found: str, *, needed: str = "", remedy: str = "", passing: bool = False) -> StoreError:
    error = StoreError(found, source=_name(url), needed=needed, remedy=remedy)
    error.passing = passing
    return error


def _told(url: str, error: Any) -> StoreError:
    """Return a driver's fault in one line."""
    import sqlalchemy as sa  # noqa: PLC0415
    from sqlalchemy.exc import DBAPIError  # noqa: PLC0415

    before = error
    while (before := before.__context__) is not None:  # once a transaction has failed, what ends it fails too
        error = before if isinstance(before, DBAPIError) else error
    words = str(error.orig).strip()
    secret = sa.make_url(url).password
    if secret:
        words = words.replace(str(secret), "...")
    low, line = words.lower(), " ".join(words.split())[:300]
    if any(word in low for word in _LOCKED):
        return _error(url, "locked by somebody else", remedy="try again when that has ended", passing=True)
    if any(word in low for word in _FULL):
        return _error(url, "its disk is full", remedy="make room, then try again", passing=True)
    if "not a database" in low or "malformed" in low:
        return _error(url, "no database, or a damaged one", remedy="name another file, or restore it from a copy")
    if "readonly" in low or "read-only" in low or "permission denied" in low:
        return _error(url, f"may not be written ({line})", remedy="check its owner and rights")
    if _REFUSED.search(low):
        return _error(url, f"refuses who asks ({line})", remedy="check user, password and database, and their rights")
    down = (
        "connect" in low
        or "refused" in low
        or "unable to open" in low
        or "resolve host" in low
        or error.connection_invalidated
    )
    return _error(
        url,
        f"{'cannot be reached' if down else 'refused the work'} ({line})",
        remedy="check that it is running and the URL is right" if down else "see what it says",
        passing=bool(down),
    )
