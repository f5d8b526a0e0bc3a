"""The quick check of a recording: all findings, and what its timeline shows."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from boxcal.calib.check_log.drive import drive_findings
from boxcal.calib.check_log.findings import LogFinding, look, refused, sentence
from boxcal.calib.check_log.recorded import recording_findings
from boxcal.calib.check_log.stops import light_at_stops, stop_findings
from boxcal.calib.planning.floor import Floor
from boxcal.calib.planning.goal import Goal
from boxcal.calib.results.verdict import Level
from boxcal.detect.correspondences import Correspondences, load_correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import ExtractSettings, extract_recording
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import WheelSamples, WheelUnits
from boxcal.detect.stops import Stop, find_stops
from boxcal.one_thread import one_thread
from boxcal.target.arrays import Ids
from boxcal.target.box import Target

_FRAMES = 3
"""Images of a stop that are looked at: enough to tell noise from what stays."""


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
        Stops that see the box; None where that is unknown.
    """

    name: str
    findings: tuple[LogFinding, ...]
    wheels: WheelSamples | None
    frame_t_ns: Ids
    stands: tuple[Stop, ...]
    drive: Correspondences | None

    @property
    def worst(self) -> Level:
        """The gravest level among the findings."""
        return max((f.level for f in self.findings), key=lambda level: level.rank, default=Level.GOOD)


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
    stands = find_stops(recording.wheels)
    drive, findings = None, []
    try:
        drive = extract_recording(recording, target, settings=ExtractSettings(max_frames=_FRAMES, moving=False))
    except DetectError as error:
        findings.append(refused("recording", error))
    else:
        recording = _with_clock_of(recording, drive)
        light = light_at_stops(recording, drive)
        findings += stop_findings(drive, target, light, len(stands))
        known = set(recording.notes)
        notes = [note for note in drive.source.notes if note not in known and "left out" in note]
        findings += [look("recording", sentence(note)) for note in notes]
        findings += drive_findings(drive, target, goal, floor)
    return LogCheck(
        name=path.name,
        findings=(*recording_findings(recording), *findings),
        wheels=recording.wheels,
        frame_t_ns=recording.frame_t_ns,
        stands=stands,
        drive=drive,
    )


def _with_clock_of(recording: Recording, drive: Correspondences) -> Recording:
    """Return a recording with its images' times as they were put right when the drive was extracted from it."""
    offset = round(drive.source.clock_offset * 1e9) - recording.clock_offset_ns
    return recording.with_clock_offset(offset) if offset else recording


def _of_correspondences(path: Path, target: Target, goal: Goal | None, floor: Floor | None) -> LogCheck:
    try:
        drive = load_correspondences(path)
    except DetectError as error:
        return _unread(path, error)
    return LogCheck(
        name=path.name,
        findings=(*stop_findings(drive, target), *drive_findings(drive, target, goal, floor)),
        wheels=drive.wheels,
        frame_t_ns=np.zeros(0, dtype=np.int64),
        stands=find_stops(drive.wheels),
        drive=drive,
    )


def _unread(path: Path, error: DetectError) -> LogCheck:
    return LogCheck(
        name=path.name,
        findings=(refused("recording", error),),
        wheels=None,
        frame_t_ns=np.zeros(0, dtype=np.int64),
        stands=(),
        drive=None,
    )
