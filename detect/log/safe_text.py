"""Names found in a log, made safe to print in an error message."""

from collections.abc import Iterable
from difflib import get_close_matches

MAX_NAME = 80
MAX_LISTED = 12


def printable(name: str) -> str:
    """Return a name with control characters replaced and its length bounded."""
    shown = "".join(c if c.isprintable() else "?" for c in name[: MAX_NAME + 1])
    return shown if len(shown) <= MAX_NAME else shown[: MAX_NAME - 3] + "..."


def listed(names: Iterable[str]) -> str:
    """Return names as ``a, b, c``, sorted, at most a dozen of them; ``none`` if there are none."""
    ordered = sorted(set(names))
    more = f" and {len(ordered) - MAX_LISTED} more" if len(ordered) > MAX_LISTED else ""
    return (", ".join(printable(n) for n in ordered[:MAX_LISTED]) or "none") + more


def counted(count: int, what: str) -> str:
    """Return a number with what it counts: ``1 stop``, ``2 stops``."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def suggestion(name: str, names: Iterable[str]) -> str:
    """Return ``; did you mean ...?`` with the closest of the names, or nothing if none is close."""
    close = get_close_matches(name, sorted(set(names))[:1000], n=1)
    return f"; did you mean {printable(close[0])}?" if close else ""
