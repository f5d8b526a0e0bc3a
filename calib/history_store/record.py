"""Results of a run put into the store, once everything is written: a store that fails costs no result."""

from collections.abc import Iterable

from boxcal.calib.history.session import sessions_of
from boxcal.calib.history_store.connection import StoreError, open_store
from boxcal.calib.history_store.place import store_url
from boxcal.calib.results.calibration import Calibration


def check_store(given: str | None) -> str:
    """Return why the store cannot be reached now, a line, empty if it can or there is none; its tables are made.

    Parameters
    ----------
    given
        The store as an option names it; None takes the environment's.

    Raises
    ------
    CalibError
        If waiting would not help: a wrong URL, a missing driver, a store of a newer version.
    """
    url = store_url(given)
    if url is None:
        return ""
    try:
        with open_store(url):
            return ""
    except StoreError as error:
        if not error.passing:
            raise
        return f"{error}; the results will be in their folder all the same"


def record(given: str | None, calibrations: Iterable[Calibration]) -> list[str]:
    """Put calibrations into the store, if there is one; return lines for the user.

    Raises
    ------
    CalibError
        If it cannot be used; nothing was put then.
    """
    url = store_url(given)
    if url is None:
        return []
    from boxcal.calib.history_store.sessions import put  # noqa: PLC0415  an extra

    with open_store(url) as connection:
        return put(connection, [session for c in calibrations for session in sessions_of(c)])
