"""Identity of logs: what tells one from any other, found without reading it as a drive."""

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from boxcal.calib.results.fingerprint import fingerprint
from boxcal.calib.settings import CORRESPONDENCES, Job
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.containers.bag_folder import folder_parts
from boxcal.detect.log.containers.hashing import file_sha256, joined_sha256
from boxcal.detect.log.remote.store import store_of, tells_content
from boxcal.detect.log.remote.urls import is_url
from boxcal.target.files.target_json import target_sha256
from boxcal.version import code_sha256

FileState = tuple[tuple[str, int, int], ...]
"""Name, size and time of change of files."""


def log_identity(log: Path) -> str:
    """Return what tells a log from any other: the hash of its bytes; behind a URL its tag and size.

    Raises
    ------
    DetectError
        If it cannot be read, or is a folder of images, which nothing short of reading it tells from another.
    """
    if is_url(log):
        return store_of(log).state().identity
    if log.is_dir():
        return joined_sha256([file_sha256(part) for part in folder_parts(log)[0]])
    return file_sha256(log)


def may_be_read(log: Path) -> bool:
    """Whether a log is behind a URL, or there: else nothing need be made ready for it."""
    return is_url(log) or os.path.exists(log)  # noqa: PTH110  false, where pathlib raises, for names too long for the system


def fingerprint_of(job: Job, drives: Sequence[Correspondences]) -> str:
    """Return the fingerprint of what comes of a job, once its logs were read; empty if one of them has no hash."""
    pairs = zip(job.logs, drives, strict=True)
    logs = [log_identity(log) if log.suffix == CORRESPONDENCES else drive.source.sha256 for log, drive in pairs]
    return job_fingerprint(job, logs) if all(map(tells_content, logs)) else ""


def job_fingerprint(job: Job, logs: Sequence[str]) -> str:
    """Return the fingerprint of what comes of a job, given what tells each of its logs from any other."""
    return fingerprint(logs, target_sha256(job.target), asdict(job.settings), code_sha256())


def file_state(log: Path) -> FileState:
    """Return name, size and time of change (ns) of a log's files, to see whether they change; of a URL nothing."""
    if is_url(log) or not log.exists():
        return ()
    files = sorted(p for p in log.iterdir() if p.is_file()) if log.is_dir() else [log]
    return tuple((path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files)
