"""Lines on stderr while a fleet is calibrated."""

import sys
from contextlib import suppress


def tell(line: str) -> None:
    """Print a line on stderr; if nobody reads it, the work goes on."""
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)
