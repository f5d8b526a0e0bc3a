"""Provenance of a result: version, command, inputs and settings."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from boxcal.calib.results.calibration import Provenance
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
        inputs={
            **{drive.source.log: drive.source.sha256 for drive in drives},
            "target": drives[0].source.target_sha256,
        },
        settings=plain_settings(settings),
        fingerprint=fingerprint,
    )


def plain_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as JSON keeps them: lists for tuples, of a path only its name."""
    return {name: _plain(value) for name, value in settings.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return value.name
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value
