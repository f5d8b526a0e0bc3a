"""Results of a run put into the store, once everything is written: a store that fails costs no result."""

from collections.abc import Iterable

from boxcal.calib.history.session import session_of
from boxcal.calib.history_store.connection import StoreError, open_store
from boxcal.calib.results.calibration import Calibration


def check_store(url: str) -> str:
    """Return why a store cannot be reached now, a line, empty if it can; its tables are made.

    Raises
    ------
    StoreError
        If waiting would not help: a wrong URL, a missing driver, a store of a newer version.
    """
    try:
        with open_store(url):
            return ""
    except StoreError as error:
        if not error.passing:
            raise
        return f"{error}; the results will be in their folder all the same"


def record(url: str, calibrations: Iterable[Calibration]) -> list[str]:
    """Put calibrations into a store; return lines for the user.

    Raises
    ------
    StoreError
        If it cannot be used; nothing was put then.
    """
    from boxcal.calib.history_store.sessions import put  # noqa: PLC0415  an extra

    with open_store(url) as connection:
        return put(connection, [session_of(c) for c in calibrations])
