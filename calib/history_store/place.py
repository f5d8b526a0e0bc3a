"""The place of a store: a file of SQLite, or the URL of a database."""

import os
import re
from pathlib import Path

from boxcal.calib.errors import CalibError

VARIABLE = "BOXCAL_STORE"
"""Environment variable that names the store where no option does; only there a URL may hold a password."""
_PASSWORD = re.compile(r"//[^/@]*:[^@]*@|[?&]password=", re.IGNORECASE)


def store_url(given: str | None) -> str | None:
    """Return the SQLAlchemy URL of the store that an option names, or else the environment; None if neither does.

    A path is a file of SQLite.

    Raises
    ------
    CalibError
        If an option's URL holds a password: the command line is written into every result.
    """
    if given is not None and _PASSWORD.search(given):
        raise CalibError(
            "--store holds a password, and the command line is written into results",
            remedy=f"give the URL by the environment ({VARIABLE}), or the password by PGPASSWORD or ~/.pgpass",
        )
    text = given or os.environ.get(VARIABLE, "")
    if not text:
        return None
    return text if "://" in text else f"sqlite:///{Path(text).expanduser()}"
