"""The contract between seeing and calibrating: what each stop saw, and what the wheels did between stops."""

import io
import json
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.wheel_samples import Array, Ids, WheelSamples
from boxcal.target.files.atomic_write import write_atomically

SCHEMA = 1
MAX_FILE_BYTES = 1 << 30
_STOP_ARRAYS = ("landmark_ids", "p_box", "uv_px", "cov_px2")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StopObservation:
    """What the camera saw while the robot stood still once.

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
    uv_px : (L, 2), px
        Where they were seen, mean over the frames of the stop; pixel (0, 0) is the centre of the top-left pixel.
    cov_px2 : (L, 2, 2), px^2
        Covariance of ``uv_px``.
    frames
        How many frames were combined.
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

    def __post_init__(self) -> None:
        n = self.landmark_ids.shape[0]
        shapes = (self.p_box.shape, self.uv_px.shape, self.cov_px2.shape)
        if shapes != ((n, 3), (n, 2), (n, 2, 2)):
            raise DetectError(
                f"a stop's landmarks: found shapes {shapes} for {n} ids; (L, 3), (L, 2), (L, 2, 2) needed"
            )
        if not all(np.all(np.isfinite(a)) for a in (self.p_box, self.uv_px, self.cov_px2)):
            raise DetectError("a stop's landmarks: a coordinate is not finite; drop such landmarks")


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Where correspondences came from.

    Attributes
    ----------
    log
        File name of the log (no folder).
    sha256
        Of the log's bytes, hexadecimal.
    target_sha256
        Of the landmark table that was looked for.
    """

    log: str = ""
    sha256: str = ""
    target_sha256: str = ""


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
    """

    robot: str
    image_size: tuple[int, int]
    wheels: WheelSamples
    stops: tuple[StopObservation, ...]
    source: Source = Source()

    def __post_init__(self) -> None:
        last = -1
        for j, stop in enumerate(self.stops):
            if not last < stop.first_sample <= stop.last_sample < len(self.wheels):
                raise DetectError(
                    f"stop {j}: wheel samples {stop.first_sample} to {stop.last_sample} do not follow sample {last} "
                    f"within the {len(self.wheels)} there are"
                )
            last = stop.last_sample

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

    def save(self, path: Path) -> None:
        """Write one ``.npz`` file (atomically)."""
        header: dict[str, Any] = {
            "schema": SCHEMA,
            "robot": self.robot,
            "image_size": list(self.image_size),
            "source": asdict(self.source),
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
                    )
                }
                for s in self.stops
            ],
        }
        arrays: dict[str, Any] = {
            "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8),
            "t_ns": self.wheels.t_ns,
            "phi_R": self.wheels.phi_R,
            "phi_L": self.wheels.phi_L,
        }
        for j, stop in enumerate(self.stops):
            arrays.update({f"stop{j}_{name}": getattr(stop, name) for name in _STOP_ARRAYS})
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **arrays)
        write_atomically(path, buffer.getvalue())


def load_correspondences(path: Path) -> Correspondences:
    """Read what :meth:`Correspondences.save` wrote.

    Raises
    ------
    DetectError
        If the file is missing, too large, of another schema or inconsistent.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise DetectError(f"{path.name}: larger than {MAX_FILE_BYTES} bytes; not a correspondence file")
        with zipfile.ZipFile(path) as archive:
            total = sum(info.file_size for info in archive.infolist())
        if total > MAX_FILE_BYTES:
            raise DetectError(f"{path.name}: unpacks to {total} bytes, more than {MAX_FILE_BYTES}; not read")
        with np.load(path, allow_pickle=False) as data:
            header = json.loads(bytes(data["header"]))
            if header["schema"] != SCHEMA:
                raise DetectError(
                    f"{path.name}: schema {header['schema']!r}, this version reads {SCHEMA}; extract it again"
                )
            stops = tuple(
                StopObservation(**stop, **{name: data[f"stop{j}_{name}"] for name in _STOP_ARRAYS})
                for j, stop in enumerate(header["stops"])
            )
            return Correspondences(
                robot=str(header["robot"]),
                image_size=(int(header["image_size"][0]), int(header["image_size"][1])),
                wheels=WheelSamples(t_ns=data["t_ns"], phi_R=data["phi_R"], phi_L=data["phi_L"]),
                stops=stops,
                source=Source(**header["source"]),
            )
    except DetectError:
        raise
    except OSError as error:
        raise DetectError(f"{path.name}: cannot be read ({error.strerror or error})") from error
    except (ValueError, KeyError, TypeError, IndexError, EOFError, zipfile.BadZipFile) as error:
        raise DetectError(f"{path.name}: not a correspondence file ({error}); extract it again") from error
