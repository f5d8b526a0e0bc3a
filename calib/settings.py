"""Settings of a calibration and jobs of a fleet."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import radians
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.likelihood import CameraKind
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.log.choices import member
from boxcal.detect.log.opener import robot_name_of
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_parameters import DriverWheels
from boxcal.detect.log.wheel_samples import WheelUnits
from boxcal.target.box import Target
from boxcal.target.errors import BoxcalError, one_line

CORRESPONDENCES = ".npz"
"""Suffix of a correspondence file, which stands for a log that was read before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Nominal:
    """Nominal wheels.

    Attributes
    ----------
    wheel_radius, wheel_separation : m
        One radius for both wheels; distance between them.
    source
        File name that they came from.
    multipliers
        Of the right radius, the left radius and the separation, as the robot's driver has them.
    """

    wheel_radius: float
    wheel_separation: float
    source: str
    multipliers: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def driver(self) -> tuple[float, float] | None:
        """Wheel radius and separation, m, that odometry is reckoned with; None if its wheels have two radii."""
        right, left, apart = self.multipliers
        wheels = DriverWheels(
            radius=self.wheel_radius, separation=self.wheel_separation, right=right, left=left, apart=apart
        )
        return wheels.reckoned


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of a calibration that a user may choose.

    In the place of a member of an enumeration its name will do: ``Settings(lens="brown", moving="off")``.

    Attributes
    ----------
    topics
        Topics and joints, where their names do not say.
    cameras
        Topics of the cameras that are calibrated together, where the robot has several; the first one's result is the
        robot's own.
    all_cameras
        Every image topic that shows the box is one of them.
    wheel_units
        What the wheel readings mean.
    bits
        Used bits of frames stored in 16; estimated from the frames if None.
    camera_mode
        One set of intrinsics for all stops, or one for every stop alone (the paper's).
    closed_form
        The four steps alone, without the likelihood.
    validate
        Whether every stop is left out in turn and predicted (leave-one-out cross-validation).
    lens, optional
        Camera model; if None the images choose, and the result says how all models did.
    rigid_floor
        Every stop stands on one plane exactly, as in the paper; else it leans a little, by how much the data say.
    tilt_prior : rad
        Standard deviation of the floor's tilt against the box.
    ink_prior : m
        Of the dot gain: how far all edges of the tags' black lie outwards. A camera's response curve looks the same.
    scale_prior, optional
        Of the print's scale in x and y, relative. If None the data say how well the target was made; 0 takes it as
        described.
    size_prior : m
        To what the box' width and depth were measured; 0 if they were not.
    face_prior : (rad, m), optional
        Of the poses of the faces, likewise.
    bow_prior : m, optional
        Of each face's outward sagitta, likewise.
    encoder_step : rad, optional
        Found from the samples if None.
    slip : m/sqrt(m), optional
        Estimated if None.
    moving
        Whether frames taken between stops are used: where the data allow it, always, or never.
    report
        Whether ``report.html`` is written for every robot; the fleet's is the caller's.
    draw
        Whether each stop's image is written with detected and reprojected corners.
    nominal
        What a data sheet says of the wheels, for diff_drive_controller's multipliers.
    base_frame, camera_frame, prefix
        Frames in the files for ROS: on the floor below the axle, and the camera's optical frame; what stands before
        both. ROS' usual base and the log's own camera frame where none is given.
    controller
        Name of the node that drives the wheels.
    rerun, results_mcap
        Files for the Rerun viewer and for Foxglove.
    hardware
        Hardware revision of the robot, by which the fleet's page groups; empty if nobody said.

    Examples
    --------
    >>> import boxcal
    >>> topics = boxcal.Topics(camera_topic="/front/image_raw", left_joint="wheel_l", right_joint="wheel_r")
    >>> degrees = boxcal.WheelUnits(unit=boxcal.JointUnit.DEGREES)
    >>> settings = boxcal.Settings(topics=topics, wheel_units=degrees, lens=boxcal.CameraKind.BROWN)
    >>> settings.slip is None  # estimated
    True
    """

    topics: Topics = field(default_factory=Topics)
    cameras: tuple[str, ...] = ()
    all_cameras: bool = False
    wheel_units: WheelUnits = field(default_factory=WheelUnits)
    bits: int | None = None
    camera_mode: CameraMode = CameraMode.JOINT
    closed_form: bool = False
    validate: bool = False
    lens: CameraKind | None = None
    rigid_floor: bool = False
    tilt_prior: float = radians(1.0)
    ink_prior: float = 1e-4
    scale_prior: float | None = None
    size_prior: float = 0.0
    face_prior: tuple[float, float] | None = None
    bow_prior: float | None = None
    encoder_step: float | None = None
    slip: float | None = None
    moving: Moving = Moving.AUTO
    report: bool = True
    draw: bool = False
    nominal: Nominal | None = None
    base_frame: str | None = None
    camera_frame: str | None = None
    prefix: str = ""
    controller: str = "diff_drive_controller"
    rerun: Path | None = None
    results_mcap: Path | None = None
    hardware: str = ""

    def __post_init__(self) -> None:
        for name, kind in (("camera_mode", CameraMode), ("lens", CameraKind), ("moving", Moving)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, member(kind, value, setting=name, error=CalibError))

    @property
    def several_cameras(self) -> bool:
        """Whether more cameras than one are asked for."""
        return self.all_cameras or len(self.cameras) > 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One robot to calibrate.

    Attributes
    ----------
    robot
        Its name: the folder that its results go to.
    logs
        Its recordings (MCAP), or correspondences saved before (``.npz``); several drives are solved together.
    target
        The landmark table.
    settings
        What the user chose.
    out
        Folder that gets ``<robot>/calibration.json`` and what is made from it; None writes nothing.
    command
        The command line, for the provenance.
    fingerprint
        Of all that the result depends on, once the logs were read (see :mod:`boxcal.calib.results.fingerprint`).
    """

    robot: str
    logs: tuple[Path, ...]
    target: Target
    settings: Settings
    out: Path | None
    command: str = ""
    fingerprint: str = ""


READ_FRACTION, SOLVED_FRACTION = 0.7, 0.95
"""Fractions of a robot's work, by measurement on logs of 20 stops: reading takes most of it."""
NOTE = "note"
"""Stage of a sentence that is only said, such as of a worker that is not used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Progress of the work on one robot.

    Attributes
    ----------
    robot
        Its name.
    name
        Of the stage: ``read``, ``solve``, ``write``; ``note`` (:data:`NOTE`) for a sentence that is only said.
    text
        What is going on, for people.
    share
        Of the robot's whole work, 0 to 1.
    """

    robot: str
    name: str
    text: str
    share: float


Progress = Callable[[Stage], None]
"""Called with how far the work has come."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Outcome of one robot's job: a calibration, or the reason why there is none.

    Attributes
    ----------
    job
        What was to be done.
    calibration
        The result with its verdict, without what grows with its drive (:mod:`boxcal.calib.results.without_drive`);
        None if it failed.
    error
        Why it failed; None if all went well.
    details
        Traceback of an error that is ours, not the input's; else empty.
    seconds
        Time taken.
    """

    job: Job
    calibration: Calibration | None
    error: BoxcalError | None = None
    details: str = ""
    seconds: float = 0.0


def robot_name(log: Path) -> str:
    """Return the robot that a log belongs to: the log's stem, with ``_`` for what cannot be printed.

    Raises
    ------
    CalibError
        If the stem cannot name a folder.
    """
    stem = log.parent.name if log.name == f"correspondences{CORRESPONDENCES}" else robot_name_of(log)
    name = "".join(letter if letter.isprintable() else "_" for letter in stem)
    if name in {"", ".", ".."}:
        raise CalibError(f"{log.name!r}: no name for a robot can be made of it", remedy="rename the file")
    return name


def listed(logs: Sequence[Path]) -> str:
    """Return the names of logs in one line; of saved correspondences, which are all named alike, with their folder."""
    saved = f"correspondences{CORRESPONDENCES}"
    return one_line(", ".join(f"{log.parent.name}/{log.name}" if log.name == saved else log.name for log in logs))
