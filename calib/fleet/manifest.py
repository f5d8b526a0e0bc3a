"""A fleet's manifest: a CSV table with a row a robot, that names its logs, its box and its options.

The first row names the columns: ``log`` (several of one robot with ``;`` between, as are topics of several cameras),
``robot`` (else called as its log), ``target``, and any option of ``fleet-calibrate`` that is about one robot, without
its dashes (``joint-unit``, ``nominal`` ...). An empty cell leaves what the command line says. Paths are taken from the
manifest's folder.
"""

import argparse
import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.chosen_settings import chosen_settings
from boxcal.calib.settings import Job, robot_name
from boxcal.detect.log.remote.store import expanded, fetched
from boxcal.detect.log.remote.urls import is_url
from boxcal.detect.log.safe_text import listed, printable, suggestion
from boxcal.target.box import Target

MAX_BYTES = 16 << 20
MAX_ROWS = 100_000
SUFFIX = ".csv"
OPTIONS = (
    *("camera-topic", "all-cameras", "joint-topic", "left-joint", "right-joint", "joint-unit", "ticks-per-turn"),
    *("reverse-left", "reverse-right", "base-frame", "camera-frame", "prefix", "controller", "bits", "nominal"),
    *("tilt-prior-deg", "ink-prior-mm", "scale-prior-percent", "face-prior-mm", "bow-prior-mm", "size-prior-mm"),
    *("encoder-step-deg", "slip-mm", "moving", "hardware", "lens", "floor"),
)
"""Options of the command that a column may set."""
_PATHS = {"nominal"}
_YES, _NO = {"yes", "true", "1", "x"}, {"no", "false", "0"}
_COLUMNS = ("robot", "log", "target", *OPTIONS)


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestRow:
    """One robot of a manifest.

    Attributes
    ----------
    source, line
        The manifest, and where in it the row stands.
    robot
        Its name.
    logs
        Its recordings.
    target
        The box's file, None if the manifest does not say.
    options
        What the row sets, by the option's name in a parsed command line.
    """

    source: Path
    line: int
    robot: str
    logs: tuple[Path, ...]
    target: Path | None
    options: Mapping[str, Any]


def read_manifest(path: Path, parser: argparse.ArgumentParser) -> list[ManifestRow]:
    """Return the robots of a manifest.

    Parameters
    ----------
    path
        The file, or its URL.
    parser
        Of the command line: it says what an option's value may be.

    Raises
    ------
    CalibError
        If it cannot be read, or at the first cell that is wrong: its line and column, what was found and is needed.
    DetectError
        If it lies behind a URL that cannot be read.
    """
    table = list(_cells(path))
    if not table:
        raise CalibError(
            "an empty manifest", source=path.name, needed=f"a first row of columns is needed ({listed(_COLUMNS)})"
        )
    (_, columns), *rows = table
    columns = [c.strip().lstrip("-").replace("_", "-").lower() for c in columns]
    for k, column in enumerate(columns):
        if column not in _COLUMNS or column in columns[:k]:
            twice = column in columns[:k]
            raise CalibError(
                f"line 1, column {k + 1}: {printable(column)!r} {'stands there twice' if twice else 'is no column'}",
                source=path.name,
                needed=f"columns are {listed(_COLUMNS)}",
                remedy=f"correct it{suggestion(column, _COLUMNS)}",
            )
    if "log" not in columns:
        raise CalibError("line 1: no column 'log'", source=path.name, remedy="add it: a path or URL a robot")
    found: dict[str, ManifestRow] = {}
    for line, row in rows:
        if not any(cell.strip() for cell in row):
            continue
        if len(row) > len(columns):
            raise _wrong(
                path, line, f"column {len(columns) + 1}", "more cells than columns", "quote a cell with a comma"
            )
        one = _row(path, line, dict(zip(columns, (cell.strip() for cell in row), strict=False)), parser)
        if one.robot in found:
            raise _wrong(
                path,
                line,
                "column 'robot'" if "robot" in columns else "column 'log'",
                f"robot {printable(one.robot)} stands in line {found[one.robot].line} already",
                "name all its drives in one cell, with ; between, or give another name",
            )
        found[one.robot] = one
    if not found:
        raise CalibError("a manifest without robots", source=path.name, remedy="add a row a robot")
    return list(found.values())


def given_manifest(args: argparse.Namespace, parser: argparse.ArgumentParser) -> list[ManifestRow]:
    """Return the rows of the manifest that stands on a command line instead of logs; none if none does.

    Raises
    ------
    CalibError
        If something is wrong with it, or more than it is given.
    """
    found = [log for log in args.logs if log.suffix.lower() == SUFFIX]
    if not found:
        return []
    if len(args.logs) > 1 or args.same_robot:
        raise CalibError(
            "a manifest stands alone: it names all logs, and which are of one robot",
            source=found[0].name,
            remedy="leave out the other logs and --same-robot",
        )
    return read_manifest(found[0], parser)


def logs_of(given: Sequence[Path], rows: Sequence[ManifestRow]) -> list[Path]:
    """Return the logs of a manifest's rows, or those given, with globs on URLs resolved."""
    return [log for row in rows for log in row.logs] if rows else [log for name in given for log in expanded(name)]


def jobs_of(
    rows: Sequence[ManifestRow], args: argparse.Namespace, target: Target, *, report: bool, command: str
) -> list[Job]:
    """Return a job for each row: what it does not set is as on the command line."""
    return [
        Job(
            robot=row.robot,
            logs=row.logs,
            target=target,
            settings=chosen_settings(argparse.Namespace(**(vars(args) | dict(row.options))), target, report=report),
            out=args.out,
            command=command,
        )
        for row in rows
    ]


def one_target(rows: Sequence[ManifestRow]) -> Path | None:
    """Return the box's file that a manifest's rows agree on, None if none names one (CalibError if they do not)."""
    named = [row for row in rows if row.target is not None]
    for row in named:
        if row.target != named[0].target:
            raise _wrong(
                row.source,
                row.line,
                "column 'target'",
                f"another box than in line {named[0].line}",
                "give a manifest and a folder of results a box",
            )
    return named[0].target if named else None


def _cells(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of a manifest's rows."""
    try:
        if is_url(path):
            content = fetched(path, MAX_BYTES)
        else:
            with path.open("rb") as file:
                content = file.read(MAX_BYTES + 1)
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise CalibError(
            f"cannot be read ({error.strerror or error})", source=path.name, remedy="check the path"
        ) from error
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise CalibError(f"line {line}: not UTF-8", source=path.name, remedy="save it as CSV in UTF-8") from error
    if len(content) > MAX_BYTES:
        raise CalibError(f"more than {MAX_BYTES} bytes", source=path.name, remedy="split the manifest")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for k, row in enumerate(reader):
            if k > MAX_ROWS:
                raise CalibError(f"more than {MAX_ROWS} rows", source=path.name, remedy="split the manifest")
            yield reader.line_num, row
    except csv.Error as error:
        raise CalibError(f"line {reader.line_num}: {error}", source=path.name, remedy="save it as CSV") from error


def _row(path: Path, line: int, cells: Mapping[str, str], parser: argparse.ArgumentParser) -> ManifestRow:
    logs: list[Path] = []
    for name in filter(None, (part.strip() for part in cells.get("log", "").split(";"))):
        logs += expanded(_placed(path, name))
    if not logs:
        raise _wrong(path, line, "column 'log'", "is empty", "name the robot's log")
    robot = cells.get("robot", "")
    if robot and (not robot.isprintable() or "/" in robot or robot in {".", ".."} or len(robot) > 200):
        raise _wrong(path, line, "column 'robot'", f"{printable(robot)!r} cannot name a folder", "give another name")
    options: dict[str, Any] = {}
    for column in OPTIONS:
        if cells.get(column):
            value = str(_placed(path, cells[column])) if column in _PATHS else cells[column]
            options |= _parsed(path, line, column, value, parser)
    if "camera_topic" in options:  # of several cameras with ; between, as logs are
        options["camera_topic"] = [topic.strip() for topic in cells["camera-topic"].split(";") if topic.strip()]
    target = cells.get("target", "")
    return ManifestRow(
        source=path,
        line=line,
        robot=robot or robot_name(logs[0]),
        logs=tuple(logs),
        target=_placed(path, target) if target else None,
        options=options,
    )


def _placed(manifest: Path, name: str) -> Path:
    return Path(name) if is_url(name) else manifest.parent / name


class _CellError(Exception):
    """A cell that the parser refuses."""


def _refuse(message: str) -> NoReturn:
    raise _CellError(message)


def _parsed(path: Path, line: int, column: str, value: str, parser: argparse.ArgumentParser) -> dict[str, Any]:
    """Return what a cell sets, as the command line would (CalibError with line and column if it would refuse it)."""
    name = column.replace("-", "_")
    flag = isinstance(parser.get_default(name), bool)
    if flag and value.lower() not in _YES | _NO:
        raise _wrong(path, line, f"column {column!r}", f"{printable(value)!r} is neither yes nor no", "correct it")
    if flag:
        return {name: value.lower() in _YES}
    said, parser.error = parser.error, _refuse  # type: ignore[method-assign]
    try:
        return {name: getattr(parser.parse_args(["log", f"--{column}={value}"]), name)}
    except _CellError as error:
        found = str(error).removeprefix(f"argument --{column}: ")
        raise _wrong(path, line, f"column {column!r}", printable(found), "correct it") from error
    finally:
        parser.error = said  # type: ignore[method-assign]


def _wrong(path: Path, line: int, where: str, found: str, remedy: str) -> CalibError:
    return CalibError(f"line {line}, {where}: {found}", source=path.name, remedy=remedy)
