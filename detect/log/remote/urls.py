"""URLs as paths: ``s3://bucket/r07.mcap`` goes through the program as the path that it is spelled like.

``Path("s3://bucket/r07.mcap")`` is ``s3:/bucket/r07.mcap``; name, suffix and parent are those of the URL, and
:func:`url_of` gives the URL back. So whatever takes a path takes a URL, and only what opens it must know. A URL that
holds credentials is refused: it would be written into results and messages.
"""

import re
from pathlib import Path

from boxcal.detect.errors import DetectError

SCHEMES = ("s3", "gs", "gcs", "az", "abfs", "abfss", "http", "https", "file", "memory")
"""What is taken for a URL."""
_URL = re.compile(rf"^({'|'.join(SCHEMES)}):/+(.*)$", re.DOTALL)
_SECRETS = re.compile(r"^[^/]*@|[?#]", re.DOTALL)


def url_of(path: str | Path) -> str | None:
    """Return the URL that a path is spelled like; None if it is a path of this machine.

    Raises
    ------
    DetectError
        If it holds a user, a password or a query; of the message only scheme and name are the URL's.
    """
    found = _URL.match(path if isinstance(path, str) else path.as_posix())
    if found is None:
        return None
    scheme, rest = found.groups()
    host = rest.partition("/")[0]
    if ("@" in host and scheme not in {"abfs", "abfss"}) or _SECRETS.search(rest.replace("@", "", 1)):
        name = re.split(r"[?#]", rest)[0].rsplit("/", 1)[-1].rpartition("@")[2]
        raise DetectError(
            f"a URL ({scheme}) with a user, a password or a query",
            source=name,
            needed="one without credentials is needed, since results and messages name it",
            remedy="keep credentials in the environment or the client's own files (docs/recording.md)",
        )
    return f"{scheme}://{'/' if scheme == 'file' else ''}{rest}"


def is_url(path: str | Path) -> bool:
    """Return whether a path is spelled like a URL."""
    return _URL.match(path if isinstance(path, str) else path.as_posix()) is not None
