"""Members of enumerations by their names, for settings that are given in Python."""

from enum import StrEnum
from typing import TypeVar

from boxcal.detect.log.safe_text import listed, printable
from boxcal.target.errors import BoxcalError

E = TypeVar("E", bound=StrEnum)


def member(kind: type[E], value: str, *, setting: str, error: type[BoxcalError]) -> E:
    """Return the member of an enumeration that a value is or names (an error of that type if it is none).

    Members are compared by identity, so that a plain string in the place of one would pass for none of them.
    """
    try:
        return kind(value)
    except ValueError:
        raise error(f"{setting} is {printable(str(value))}", needed=f"one of {listed(kind)} is needed") from None
