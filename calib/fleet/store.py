"""What a folder of results says of itself: ``fleet.json``."""

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.calib.settings import Outcome
from boxcal.target.box import Target
from boxcal.target.files.json_document import read_json
from boxcal.target.files.target_json import target_sha256
from boxcal.version import installed_version

FLEET = "fleet.json"
"""What a folder of results says of itself."""


def check_folder(out: Path, target: Target) -> None:
    """Refuse a folder that holds the results of another fleet: one that drove around another box.

    Raises
    ------
    CalibError
        If its ``fleet.json`` names another target, or is no such file.
    """
    path = out / FLEET
    if not path.exists():
        return
    remedy = "give another folder with --out"
    fleet = read_json(path, "a fleet's file", error=CalibError, remedy=remedy)
    if "target" not in fleet:
        raise CalibError("not what fleet-calibrate writes", source=path, remedy=remedy)
    found = str(fleet["target"])
    if found != target_sha256(target):
        raise CalibError(
            f"holds the results of a fleet with another target ({found[:8]}, now {target_sha256(target)[:8]})",
            source=out,
            remedy=remedy,
        )


def fleet_record(outcomes: Sequence[Outcome], target: Target, command: str) -> bytes:
    """Return the content of ``fleet.json``: what a folder holds, and the failures."""
    document = {
        "schema": 1,
        "version": installed_version(),
        "command": command,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "target": target_sha256(target),
        "robots": {
            o.job.robot: str(o.calibration.verdict.level)
            for o in outcomes
            if o.calibration is not None and o.calibration.verdict is not None
        },
        "failed": {o.job.robot: str(o.error) for o in outcomes if o.calibration is None},
    }
    return (json.dumps(document, indent=2) + "\n").encode()
