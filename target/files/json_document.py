"""JSON from outside, read within bounds: size, nesting, and what stands at the top."""

import json
import re
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from boxcal.target.errors import BoxcalError

MAX_BYTES = 64 << 20
"""Largest document that is read, bytes; the largest that is written (a target of 40 000 tags) has some 10 MB."""
MAX_DEPTH = 32
"""Deepest nesting that is read; the deepest that is written is 7."""
_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)
_NOT_BRACKETS = bytes(b for b in range(256) if b not in b"[]{}")


def read_json(
    path: Path, what: str, *, error: type[BoxcalError], remedy: str, max_bytes: int = MAX_BYTES
) -> dict[str, Any]:
    """Return the JSON object in a file.

    Parameters
    ----------
    path
        The file.
    what
        What it should be, with its article: ``a calibration``.
    error
        Raised with the path as its source.
    remedy
        What to do, for the error.
    max_bytes
        Largest file that is read.

    Raises
    ------
    BoxcalError
        Of the kind ``error``: if the file is missing, cannot be read, is too large or no JSON object.
    """
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except OSError as cause:
        raise error(f"cannot be read ({cause.strerror or cause})", source=path, remedy=remedy) from cause
    return parse_json(content, what, error=error, source=path, remedy=remedy, max_bytes=max_bytes)


def parse_json(
    content: bytes,
    what: str,
    *,
    error: type[BoxcalError],
    source: object = "",
    remedy: str = "",
    max_bytes: int = MAX_BYTES,
) -> dict[str, Any]:
    """Return the JSON object in bytes; as :func:`read_json` without the file."""
    if len(content) > max_bytes:
        raise error(f"larger than {max_bytes} bytes, {what} is not", source=source, remedy=remedy)
    if _depth(content) > MAX_DEPTH:
        raise error(f"nested deeper than {MAX_DEPTH} levels, {what} is not", source=source, remedy=remedy)
    try:
        document = json.loads(content, parse_constant=_refuse)
    except (ValueError, RecursionError) as cause:
        raise error(f"not a whole JSON file ({cause})", source=source, remedy=remedy) from cause
    if not isinstance(document, dict):
        raise error(f"not {what}", source=source, remedy=remedy)
    return document


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON number")


def _depth(content: bytes) -> int:
    """Return how deeply brackets nest, those in strings aside."""
    brackets = np.frombuffer(_STRINGS.sub(b"", content).translate(None, _NOT_BRACKETS), dtype=np.uint8)
    steps = np.where((brackets == ord("[")) | (brackets == ord("{")), 1, -1)
    return int(np.cumsum(steps).max(initial=0))
