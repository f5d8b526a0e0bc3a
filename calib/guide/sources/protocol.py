"""Messages of a server that are not of its protocol, said in one sentence."""

import contextlib
from collections.abc import Iterator

from boxcal.calib.guide.sources.link import Link
from boxcal.detect.errors import DetectError
from boxcal.detect.log.safe_text import printable

_MOST_SAID = 80


@contextlib.contextmanager
def spoken(link: Link, what: str, remedy: str) -> Iterator[None]:
    """Turn what goes wrong in taking a message into a sentence about the protocol.

    Parameters
    ----------
    link
        To the server.
    what, remedy
        What such a message, or its server, is, and what to do.

    Raises
    ------
    DetectError
        If the message is not of the protocol.
    """
    try:
        yield
    except DetectError:
        raise
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise DetectError(f"{what} ({printable(str(error)[:_MOST_SAID])})", source=link.name, remedy=remedy) from error
