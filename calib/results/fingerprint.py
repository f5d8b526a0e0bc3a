"""Fingerprint of all that a result depends on, by which it is known whether it would come out again."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from boxcal.calib.results.provenance import plain_settings

JOINT = "-joint"
"""End of the fingerprint of a result with the box that all robots of a run solved together."""


def fingerprint(logs: Sequence[str], target: str, settings: Mapping[str, Any], code: str) -> str:
    """Return the fingerprint of a result, hexadecimal.

    Parameters
    ----------
    logs
        What tells each log from any other: its SHA-256, or the tag and size of one behind a URL.
    target
        SHA-256 of the box's landmark table.
    settings
        Everything that was asked for.
    code
        SHA-256 of the program.
    """
    parts = {"logs": list(logs), "target": target, "settings": plain_settings(settings), "code": code}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
