"""The contract between seeing and calibrating: what each stop saw, and what the wheels did between stops."""

import json
import zipfile
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.image.gray import MAX_SIDE_PX
from boxcal.detect.log.encoder import MAX_ANGLE, gaps_covered, without_strays
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.source import Source, read_source
from boxcal.detect.log.wheel_samples import Flags, JointUnit, WheelSamples, WheelUnits
from boxcal.detect.tags.faces import faces_by_normal
from boxcal.detect.tags.moving_frames import MovingFrame, refuse_corners_of_no_tag, refuse_odd_landmarks
from boxcal.target.arrays import Array, Ids
from boxcal.target.errors import one_line
from boxcal.target.files.atomic_write import write_atomically
from boxcal.target.files.json_document import parse_json
from boxcal.target.files.npz import npz_bytes

SCHEMA = 1
MAX_FILE_BYTES = 1 << 30
_STOP_ARRAYS = ("landmark_ids", "p_box", "uv_px", "cov_px2", "faces")
_FRAME_ARRAYS = (*_STOP_ARRAYS, "blur_px2")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StopObservation:
    """Landmarks seen during one stop, with the wheel angles there.

    Attributes
    ----------
    t_start_ns, t_end_ns : ns
        When the robot stood.
    first_sample, last_sample
        Wheel samples (inclusive) taken while it stood.
    phi_R, phi_L : rad
        Wheel angles at the stop.
    landmark_ids : (L,) int64
        ``4 * tag id + corner``, ascending, each once.
    p_box : (L, 3), m
        The landmarks in frame ``box``.
    faces : (L,)
        The face of the box that carries each landmark; found from the normals of the tags in ``p_box`` if not given.
    uv_px : (L, 2), px
        Where they were seen, mean over the frames of the stop; pixel (0, 0) is the centre of the top-left pixel.
    cov_px2 : (L, 2, 2), px^2
        Covariance of ``uv_px``.
    frames
        How many frames were combined.
    rejected_tags
        How many tags of the target were read that do not lie where the box has them, and were left out.
    """

    t_start_ns: int
    t_end_ns: int
    first_sample: int
    last_sample: int
    phi_R: float
    phi_L: float
    landmark_ids: Ids
    p_box: Array
    uv_px: Array
    cov_px2: Array
    frames: int
    faces: Ids = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    rejected_tags: int = 0

    def __post_init__(self) -> None:
        if self.t_end_ns < self.t_start_ns or min(self.frames, self.rejected_tags) < 0:
            raise DetectError("a stop: it ends before it begins, or its number of frames or tags is negative")
        if not all(abs(phi) <= MAX_ANGLE for phi in (self.phi_R, self.phi_L)):
            raise DetectError(f"a stop: a wheel's angle is not finite, or beyond {MAX_ANGLE:g} rad; drop that stop")
        refuse_odd_landmarks("a stop's", self.landmark_ids, (self.p_box, self.uv_px, self.cov_px2))
        n = self.landmark_ids.shape[0]
        if self.faces.size == 0:
            object.__setattr__(self, "faces", faces_by_normal(self.landmark_ids, self.p_box))
        elif self.faces.shape != (n,):
            raise DetectError(f"a stop's landmarks: {n} ids with faces of shape {self.faces.shape}; (L,) needed")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correspondences:
    """All that the calibration needs of one drive of one robot.

    Attributes
    ----------
    robot
        Name of the robot.
    image_size : px
        Width and height of the camera's images.
    wheels
        All wheel samples of the drive.
    stops
        In order of time.
    source
        Provenance.
    units
        What the wheel readings were taken for; the angles here are rad.
    moving
        Frames taken between stops that show the box, in order of time; empty where none was looked at. Of a robot that
        stood still at too few places, all frames.
    on_the_move
        Whether the stops are single frames of a robot that stood still at too few places.
    """

    robot: str
    image_size: tuple[int, int]
    wheels: WheelSamples
    stops: tuple[StopObservation, ...]
    source: Source = field(default_factory=Source)
    units: WheelUnits = field(default_factory=WheelUnits)
    moving: tuple[MovingFrame, ...] = ()
    on_the_move: bool = False

    def __post_init__(self) -> None:
        if not all(0 < side <= MAX_SIDE_PX for side in self.image_size):
            raise DetectError(
                f"images of {printable(str(self.image_size))} px, sides from 1 to {MAX_SIDE_PX} px are needed"
            )
        for stop in self.stops:
            refuse_corners_of_no_tag("a stop's", stop.uv_px, self.image_size)
        for frame in self.moving:
            refuse_corners_of_no_tag("a frame's", frame.uv_px, self.image_size)
        last = -1
        for j, stop in enumerate(self.stops):
            if not last < stop.first_sample <= stop.last_sample < len(self.wheels):
                raise DetectError(
                    f"stop {j}: wheel samples {stop.first_sample} to {stop.last_sample} do not follow sample {last} "
                    f"within the {len(self.wheels)} there are"
                )
            last = stop.last_sample
        if any(a.t_ns >= b.t_ns for a, b in pairwise(self.moving)):
            raise DetectError("frames on the move: their times do not ascend; sort them")

    def leg(self, i: int) -> tuple[Array, Array]:
        """Return the wheel angles from stop i to stop i + 1, (M,) and (M,) rad, right and left.

        The first and last entries are the two stops' own angles; between them stand the samples taken while driving.
        """
        a, b = self.stops[i], self.stops[i + 1]
        inner = slice(a.last_sample + 1, b.first_sample)
        return (
            np.concatenate([[a.phi_R], self.wheels.phi_R[inner], [b.phi_R]]),
            np.concatenate([[a.phi_L], self.wheels.phi_L[inner], [b.phi_L]]),
        )

    @property
    def legs_covered(self) -> Flags:
        """Whether the wheels cover the whole path from each stop to the next, (P - 1,) bool.

        A leg that is not covered carries no wheel information: readings are missing, or its counter was reset.
        """
        spans = [(a.last_sample + 1, b.first_sample + 1) for a, b in zip(self.stops, self.stops[1:], strict=False)]
        return np.array([bool(np.all(self.wheels.covered[first:end])) for first, end in spans], dtype=np.bool_)

    def save(self, path: str | Path) -> None:
        """Write one ``.npz`` file (atomically)."""
        header: dict[str, Any] = {
            "schema": SCHEMA,
            "robot": self.robot,
            "image_size": list(self.image_size),
            "source": asdict(self.source),
            "encoder_steps": list(self.wheels.encoder_steps),
            "units": asdict(self.units),
            "stops": [
                {
                    name: getattr(s, name)
                    for name in (
                        "t_start_ns",
                        "t_end_ns",
                        "first_sample",
                        "last_sample",
                        "phi_R",
                        "phi_L",
                        "frames",
                        "rejected_tags",
                    )
                }
                for s in self.stops
            ],
            "moving": [{"t_ns": frame.t_ns} for frame in self.moving],
            "on_the_move": self.on_the_move,
        }
        arrays: dict[str, Any] = {
            "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8),
            "t_ns": self.wheels.t_ns,
            "phi_R": self.wheels.phi_R,
            "phi_L": self.wheels.phi_L,
            "covered": self.wheels.covered,
        }
        for j, stop in enumerate(self.stops):
            arrays.update({f"stop{j}_{name}": getattr(stop, name) for name in _STOP_ARRAYS})
        for j, frame in enumerate(self.moving):
            arrays.update({f"moving{j}_{name}": getattr(frame, name) for name in _FRAME_ARRAYS})
        write_atomically(Path(path), npz_bytes(arrays))


def load_correspondences(path: str | Path) -> Correspondences:
    """Read what :meth:`Correspondences.save` wrote.

    Raises
    ------
    DetectError
        If the file is missing, too large, of another schema or inconsistent.

    Examples
    --------
    >>> import boxcal
    >>> boxcal.simulate(stops=4, seed=1).correspondences.save("drive.npz")
    >>> drive = boxcal.load_correspondences("drive.npz")
    >>> len(drive.stops), drive.image_size
    (4, (640, 480))
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise DetectError(f"{path.name}: larger than {MAX_FILE_BYTES} bytes; not a correspondence file")
        with zipfile.ZipFile(path) as archive:
            total = sum(info.file_size for info in archive.infolist())
        if total > MAX_FILE_BYTES:
            raise DetectError(f"{path.name}: unpacks to {total} bytes, more than {MAX_FILE_BYTES}; not read")
        with np.load(path, allow_pickle=False) as data:
            header = parse_json(bytes(data["header"]), "correspondences", error=DetectError, source=path.name)
            if header["schema"] != SCHEMA:
                raise DetectError(
                    f"{path.name}: schema {header['schema']!r}, this version reads {SCHEMA}; extract it again"
                )
            stops = tuple(
                StopObservation(
                    **_figures(stop), **{k: data[f"stop{j}_{k}"] for k in _STOP_ARRAYS if f"stop{j}_{k}" in data}
                )
                for j, stop in enumerate(header["stops"])
            )
            return Correspondences(
                robot=_name(header["robot"]),
                image_size=(int(header["image_size"][0]), int(header["image_size"][1])),
                wheels=_wheels(data, header),
                stops=stops,
                source=read_source(header["source"]),
                units=_units(header.get("units", {})),
                moving=tuple(
                    MovingFrame(
                        t_ns=int(frame["t_ns"]),
                        **{k: data[f"moving{j}_{k}"] for k in _FRAME_ARRAYS if f"moving{j}_{k}" in data},
                    )
                    for j, frame in enumerate(header.get("moving", []))
                ),
                on_the_move=bool(header.get("on_the_move", False)),
            )
    except DetectError:
        raise
    except OSError as error:
        raise DetectError(f"{path.name}: cannot be read ({error.strerror or error})") from error
    except MemoryError as error:
        raise DetectError(f"{path.name}: an array in it claims more than the memory holds; extract it again") from error
    except (ValueError, KeyError, TypeError, IndexError, EOFError, zipfile.BadZipFile) as error:
        why = error.args[0] if isinstance(error, KeyError) and error.args else error
        raise DetectError(f"{path.name}: not a correspondence file ({why}); extract it again") from error


def _figures(stop: dict[str, object]) -> dict[str, Any]:
    """Return what the header says of a stop: wheel angles, and whole numbers."""
    for name, value in stop.items():
        if name not in {"phi_R", "phi_L"}:
            if not isinstance(value, int):
                raise ValueError(f"a stop's {name} is no whole number")
        elif not isinstance(value, (int, float)) or not abs(value) <= MAX_ANGLE:
            raise ValueError(f"a stop's {name} is no angle to {MAX_ANGLE:g} rad")
    return stop


def _name(saved: object) -> str:
    if not isinstance(saved, str):
        raise ValueError("the robot has no name")
    return one_line(saved)


def _wheels(data: Any, header: dict[str, Any]) -> WheelSamples:
    """Return the wheel samples of a file; what files of the first versions lack is read off the angles."""
    known: dict[str, Any] = {}
    if "encoder_steps" in header:
        right, left = header["encoder_steps"]
        known["encoder_steps"] = (float(right), float(left))
    t_ns, phi_R, phi_L = data["t_ns"], data["phi_R"], data["phi_L"]
    if not np.issubdtype(t_ns.dtype, np.integer):
        raise ValueError("times of wheel samples that are no whole numbers of ns")
    if not max(np.max(np.abs(phi), initial=0) for phi in (phi_R, phi_L)) <= MAX_ANGLE:
        raise ValueError(f"wheel angles beyond {MAX_ANGLE:g} rad, or no numbers")
    if "covered" in data:
        return WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L, covered=data["covered"].astype(np.bool_), **known)
    covered = gaps_covered(t_ns, phi_R) & gaps_covered(t_ns, phi_L)
    return without_strays(WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L, covered=covered, **known))[0]


def _units(saved: dict[str, Any]) -> WheelUnits:
    return WheelUnits(**{**saved, "unit": JointUnit(saved.get("unit", JointUnit.RADIANS))})


def taken_as(drive: Correspondences, units: WheelUnits) -> Correspondences:
    """Return a drive with its wheel readings taken in other units than they were when it was made."""
    if units == drive.units:
        return drive
    right, left = (new / old for new, old in zip(units.factors, drive.units.factors, strict=True))
    step_R, step_L = drive.wheels.encoder_steps
    wheels = replace(
        drive.wheels,
        phi_R=right * drive.wheels.phi_R,
        phi_L=left * drive.wheels.phi_L,
        encoder_steps=(abs(right) * step_R, abs(left) * step_L),
    )
    stops = tuple(replace(stop, phi_R=right * stop.phi_R, phi_L=left * stop.phi_L) for stop in drive.stops)
    return replace(drive, wheels=wheels, stops=stops, units=units)
