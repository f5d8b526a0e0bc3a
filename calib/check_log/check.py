"""The quick check of a recording: all findings, and what its timeline shows."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from boxcal.calib.check_log.drive import drive_findings
from boxcal.calib.check_log.findings import Grade, LogFinding, look, wrong
from boxcal.calib.check_log.recorded import recording_findings
from boxcal.calib.check_log.stops import light_at_stops, stop_findings
from boxcal.calib.planning.floor import Floor
from boxcal.calib.planning.goal import Goal
from boxcal.detect.correspondences import Correspondences, load_correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import ExtractSettings, extract_recording
from boxcal.detect.log.recording import Recording, open_recording
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import WheelSamples, WheelUnits
from boxcal.detect.stops import Stop, find_stops
from boxcal.one_thread import one_thread
from boxcal.target.arrays import Ids
from boxcal.target.box import Target

_FRAMES = 3
"""Pictures of a stop that are looked at: enough to tell noise from what stays."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogCheck:
    """Findings of a recording, and what they were made from.

    Attributes
    ----------
    name
        Of the recording.
    findings
        One a line, in the order in which things happen: recording, stops, drive.
    wheels
        All wheel samples; None where there are none.
    frame_t_ns : (F,), ns
        When images were taken.
    stands
        Times that the robot stood.
    drive
        Stops that see the box; None where it cannot be told.
    """

    name: str
    findings: tuple[LogFinding, ...]
    wheels: WheelSamples | None
    frame_t_ns: Ids
    stands: tuple[Stop, ...]
    drive: Correspondences | None

    @property
    def worst(self) -> Grade:
        """The gravest grade among the findings."""
        order = list(Grade)
        return max((f.grade for f in self.findings), key=order.index, default=Grade.FINE)


@one_thread()
def check_log(
    path: str | Path,
    target: Target,
    *,
    topics: Topics | None = None,
    units: WheelUnits | None = None,
    goal: Goal | None = None,
    floor: Floor | None = None,
) -> LogCheck:
    """Return what is right and wrong with a recording; what cannot be read is a finding, not an error.

    Parameters
    ----------
    path
        Recording of any kind, or correspondences (``.npz``).
    target
        The box.
    topics, units
        As :func:`boxcal.detect.extract.extract`.
    goal, floor
        What is wanted, and where the robot may drive, for the next stops.
    """
    path = Path(path)
    if path.suffix == ".npz":
        return _of_correspondences(path, target, goal, floor)
    try:
        recording = open_recording(path, topics, units, hashed=False)
    except DetectError as error:
        return _unread(path, error)
    found, drive = _of_recording(recording, target, goal, floor)
    return LogCheck(
        name=path.name,
        findings=tuple(found),
        wheels=recording.wheels,
        frame_t_ns=recording.frame_t_ns,
        stands=find_stops(recording.wheels),
        drive=drive,
    )


def _of_recording(
    recording: Recording, target: Target, goal: Goal | None, floor: Floor | None
) -> tuple[list[LogFinding], Correspondences | None]:
    found = recording_findings(recording)
    try:
        drive = extract_recording(recording, target, settings=ExtractSettings(max_frames=_FRAMES))
    except DetectError as error:
        return [*found, _refused(error)], None
    light = light_at_stops(recording, drive)
    stands = len(find_stops(recording.wheels))
    found += stop_findings(drive, target, light, stands)
    known = set(recording.notes)
    found += [look("recording", f"{note}.") for note in drive.source.notes if note not in known and "left out" in note]
    return [*found, *drive_findings(drive, target, goal, floor).findings], drive


def _of_correspondences(path: Path, target: Target, goal: Goal | None, floor: Floor | None) -> LogCheck:
    try:
        drive = load_correspondences(path)
    except DetectError as error:
        return _unread(path, error)
    return LogCheck(
        name=path.name,
        findings=(*stop_findings(drive, target), *drive_findings(drive, target, goal, floor).findings),
        wheels=drive.wheels,
        frame_t_ns=np.zeros(0, dtype=np.int64),
        stands=find_stops(drive.wheels),
        drive=drive,
    )


def _unread(path: Path, error: DetectError) -> LogCheck:
    return LogCheck(
        name=path.name,
        findings=(_refused(error),),
        wheels=None,
        frame_t_ns=np.zeros(0, dtype=np.int64),
        stands=(),
        drive=None,
    )


def _refused(error: DetectError) -> LogFinding:
    what = error.found + (f"; {error.needed}" if error.needed else "")
    advice = error.remedy or ""
    return wrong("recording", _sentence(what), _sentence(advice))


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if not text or text.endswith(".") else ".")
