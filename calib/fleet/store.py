"""Contents of a results folder: the team, calibrated together or one robot after another.

The results themselves are the record: every ``<robot>/calibration.json`` of the folder belongs to it. ``fleet.json``
adds what no result can say: whose last log failed, and which box all drove around.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from boxcal.calib.errors import CalibError
from boxcal.calib.one_robot.log_identity import FileState, file_state
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.json_format import CALIBRATION, load_calibration, verdict_document
from boxcal.calib.results.without_drive import without_drive
from boxcal.calib.settings import Job, Outcome
from boxcal.target.box import Target
from boxcal.target.errors import BoxcalError
from boxcal.target.files.json_document import read_json
from boxcal.target.files.target_json import target_sha256
from boxcal.version import installed_version

FLEET = "fleet.json"
"""What a folder of results says of itself."""
PAGES = ("fleet.html", "fleet.xlsx")
"""Written with reports only; those of an earlier run do not know of this one and are removed."""
CAMERA_TABLES = {"cameras": "fleet-cameras.csv", "camera pairs": "fleet-camera-pairs.csv"}
"""Tables of robots with several cameras, by what is in them; removed where there are none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One robot of a folder.

    Attributes
    ----------
    robot
        Its name.
    calibration
        Its result; None if it has none that can be read.
    error
        Why its last log gave none; None if it did.
    stale
        Why the result is none of today, a sentence; empty if it is.
    """

    robot: str
    calibration: Calibration | None = None
    error: BoxcalError | None = None
    stale: str = ""


def check_folder(out: Path, target: Target) -> None:
    """Refuse a folder that holds the results of another fleet: one that drove around another box.

    A box of the same design that was measured anew is no other box, and a folder in which nobody was calibrated yet
    belongs to nobody.

    Raises
    ------
    CalibError
        If its ``fleet.json`` names another box, or is no such file.
    """
    document = _fleet_document(out)
    if not document.get("robots"):
        return
    design = document.get("design")
    if str(document["target"]) == target_sha256(target) or (isinstance(design, dict) and design == _design(target)):
        return
    raise CalibError(
        f"holds results of a fleet that drove around another box ({_said(design)}, now {_said(_design(target))})",
        source=out,
        remedy="give another folder with --out, or that box's file with --target",
    )


def read_folder(out: Path, target: Target, outcomes: Iterable[Outcome] = ()) -> tuple[Member, ...]:
    """Return the robots of a folder, by name, with numbers in names in their order.

    Parameters
    ----------
    out
        The folder.
    target
        The box as it is known now.
    outcomes
        What became of the robots just now; of the others the folder has results.
    """
    members = {o.job.robot: _fresh(o, out, target) for o in outcomes}
    failed = _fleet_document(out).get("failures", {})
    found = sorted(path.parent.name for path in out.glob(f"*/{CALIBRATION}")) if out.is_dir() else []
    for robot in dict.fromkeys([*found, *failed]):
        if robot not in members:
            members[robot] = _kept(robot, out, target, _error(failed.get(robot)))
    return tuple(members[robot] for robot in sorted(members, key=natural))


def results_now(jobs: Iterable[Job]) -> dict[str, FileState]:
    """Return the state of the result of each robot that has one: what was written meanwhile, whatever clocks say."""
    paths = {job.robot: job.out / job.robot / CALIBRATION for job in jobs if job.out is not None}
    return {robot: state for robot, path in paths.items() if (state := file_state(path))}


def natural(name: str) -> list[tuple[int, int, str]]:
    """Return a key that sorts names with their numbers as numbers: r2 before r10."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]


def fleet_record(members: Sequence[Member], target: Target, command: str) -> Iterator[bytes]:
    """Yield the content of ``fleet.json`` in pieces: whom the folder holds, how they were judged, and the failures."""
    calibrated = {m.robot: m.calibration for m in members if m.calibration is not None}
    verdicts = {robot: c.verdict for robot, c in calibrated.items() if c.verdict is not None}
    document = {
        "schema": 1,
        "version": installed_version(),
        "command": command,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "target": target_sha256(target),
        "design": _design(target),
        "robots": {robot: str(v.level) for robot, v in verdicts.items()},
        "failed": {m.robot: str(m.error) for m in members if m.error is not None},
        "failures": {m.robot: _parts(m.error) for m in members if m.error is not None},
        "stale": {m.robot: m.stale for m in members if m.stale},
    }
    yield json.dumps(document, indent=2, ensure_ascii=False).removesuffix("\n}").encode()
    yield b',\n  "verdicts": {'
    for k, (robot, verdict) in enumerate(verdicts.items()):
        one = json.dumps({robot: verdict_document(verdict)}, indent=2, ensure_ascii=False)
        inner = one.removeprefix("{\n").removesuffix("\n}").replace("\n", "\n  ")
        yield f"{',' if k else ''}\n  {inner}".encode()
    yield b"\n  }\n}\n" if verdicts else b"}\n}\n"


def _fresh(outcome: Outcome, out: Path, target: Target) -> Member:
    if outcome.calibration is not None:
        return Member(robot=outcome.job.robot, calibration=outcome.calibration)
    return _kept(outcome.job.robot, out, target, outcome.error)


def _kept(robot: str, out: Path, target: Target, error: BoxcalError | None) -> Member:
    """Return a robot by what the folder has of it."""
    path = out / robot / CALIBRATION
    if not path.is_file():
        return Member(robot=robot, error=error)
    try:
        calibration = without_drive(load_calibration(path))
    except CalibError as problem:
        return Member(robot=robot, error=error or problem)
    if error is not None:
        stale = f"Of an earlier log ({calibration.provenance.created[:10]}): the last one gave no calibration."
    elif calibration.provenance.target != target_sha256(target):
        stale = "Calibrated before the box was measured anew: calibrate it again."
    else:
        stale = ""
    return Member(robot=robot, calibration=calibration, error=error, stale=stale)


def _fleet_document(out: Path) -> Mapping[str, Any]:
    path = out / FLEET
    if not path.exists():
        return {}
    remedy = "give another folder with --out"
    document = read_json(path, "a fleet's file", error=CalibError, remedy=remedy)
    if "target" not in document or not isinstance(document.get("failures", {}), dict):
        raise CalibError("not what fleet-calibrate writes", source=path, remedy=remedy)
    return document


def _design(target: Target) -> dict[str, Any]:
    """Return what all built copies of a box have in common, as JSON has it."""
    design: dict[str, Any] = asdict(target.box)
    return design


def _said(design: object) -> str:
    if not isinstance(design, Mapping):
        return "its design is not given"
    try:
        size = " x ".join(f"{float(design[side]) * 1e3:g}" for side in ("width", "depth", "height"))
        return f"{size} mm, {design['columns']} x {design['rows']} tags from id {design['first_id']}"
    except (KeyError, TypeError, ValueError):
        return "its design is not given"


def _parts(error: BoxcalError) -> dict[str, str]:
    return {name: getattr(error, name) for name in ("source", "found", "needed", "remedy")}


def _error(parts: object) -> BoxcalError | None:
    if not isinstance(parts, Mapping):
        return None
    given = {name: str(parts.get(name, "")) for name in ("source", "needed", "remedy")}
    return CalibError(str(parts.get("found", "")), **given)
