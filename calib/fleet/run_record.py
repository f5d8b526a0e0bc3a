"""Record of a run, ``run.json``: what was done, what was kept, what failed, and why."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from time import monotonic
from typing import Any

from boxcal.calib.settings import Job, Outcome
from boxcal.detect.log.remote.urls import url_of
from boxcal.version import code_sha256, installed_version

RUN = "run.json"
"""Name of the record in a folder of results; each run replaces that of the one before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A run that is under way.

    Attributes
    ----------
    command
        The command line.
    engine
        Where the work is done, in words.
    jobs
        Its robots.
    why
        Robot -> why it is done; those that are not named are kept as they are.
    started
        UTC, ISO 8601.
    """

    command: str
    engine: str
    jobs: Sequence[Job]
    why: Mapping[str, str]
    started: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    _clock: float = field(default_factory=monotonic)

    def record(self, outcomes: Sequence[Outcome], ended: str = "") -> bytes:
        """Return the content of ``run.json``; ``ended`` says why the run ended early, if it did."""
        found = {outcome.job.robot: outcome for outcome in outcomes}
        robots = {job.robot: self._robot(job, found.get(job.robot)) for job in self.jobs}
        states = [robot["state"] for robot in robots.values()]
        document = {
            "schema": 1,
            "version": installed_version(),
            "code": code_sha256(),
            "command": self.command,
            "engine": self.engine,
            "started": self.started,
            "seconds": round(monotonic() - self._clock, 3),
            "ended": ended or "all robots were gone through",
            "counts": {state: states.count(state) for state in ("done", "kept", "failed", "not reached")},
            "robots": robots,
        }
        written = json.dumps(document, indent=2, ensure_ascii=False) + "\n"
        return written.encode(errors="backslashreplace")  # JSON's own escapes, of file names that are no text

    def _robot(self, job: Job, outcome: Outcome | None) -> dict[str, Any]:
        """Return what became of a robot: done, kept, failed or not reached; why; its verdict, time and logs."""
        said: dict[str, Any] = {"logs": [url_of(log) or str(log) for log in job.logs]}
        why = self.why.get(job.robot)
        if outcome is None:
            return {"state": "not reached", "why": why or "", **said}
        if outcome.calibration is None:
            return {"state": "failed", "why": str(outcome.error), "seconds": round(outcome.seconds, 3), **said}
        verdict = outcome.calibration.verdict
        said = {"verdict": str(verdict.level) if verdict else "", **said}
        if why is None:
            return {"state": "kept", "why": "log, box, settings and program are unchanged", **said}
        return {"state": "done", "why": why, "seconds": round(outcome.seconds, 3), **said}
