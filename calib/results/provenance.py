"""Provenance of a result: version, command, inputs and settings."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path
from typing import Any

from boxcal.calib.results.calibration import TARGET, Provenance
from boxcal.detect.correspondences import Correspondences
from boxcal.version import installed_version


def provenance(
    command: str, drives: Sequence[Correspondences], settings: Mapping[str, Any], fingerprint: str = ""
) -> Provenance:
    """Return how the calibration of drives comes about now.

    Parameters
    ----------
    command
        The command line.
    drives
        What is calibrated.
    settings
        What was asked for; of a path only its name is kept.
    fingerprint
        Of all that the result depends on.
    """
    return Provenance(
        version=installed_version(),
        command=command,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        inputs={**_hashes(drives), TARGET: drives[0].source.target_sha256},
        settings=plain_settings(settings),
        fingerprint=fingerprint,
    )


def _hashes(drives: Sequence[Correspondences]) -> dict[str, str]:
    """Return the hash of each drive's log by its file name, numbered where another input has that name."""
    found: dict[str, str] = {}
    for source in (drive.source for drive in drives):
        names = chain([source.log], (f"{source.log} ({number})" for number in count(2)))
        found[next(name for name in names if name not in {*found, TARGET})] = source.sha256
    return found


def plain_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as JSON keeps them: lists for tuples, of a path only its name."""
    return {name: _plain(value) for name, value in settings.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return value.name
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value
