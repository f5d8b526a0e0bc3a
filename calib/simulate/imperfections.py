"""Imperfections of robot, floor, camera and box as numbers; all zero is the rigid model."""

from dataclasses import dataclass

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Box


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelFaults:
    """Departures of wheels and encoders from two round wheels that roll.

    Attributes
    ----------
    eccentric : (4,)
        Relative amplitudes (cosine right, sine right, cosine left, sine left) of the radius over the wheel's angle.
    backward
        Relative growth of both radii while a wheel rolls backward.
    outer
        Relative growth of the outer wheel's radius in a bend; the inner one shrinks as much.
    backlash : rad
        Dead travel between encoder and wheel after each reversal, both wheels.
    scrub : (left, right, spot)
        Fraction of a turn that is lost in turns to the left, to the right, and on the spot (there beside the other).
    drift : m/rad
        Sideways motion to the left for each radian turned, in either direction.
    slip, slip_spread : m/sqrt(m), 1
        Slip of each wheel, and the standard deviation of its logarithm from leg to leg.
    slipped : (leg, right, left), m
        Travel of the wheels at one moment of a leg that does not move the robot.
    carried : (leg, x, y, heading), m and rad
        Displacement of the robot, in its own frame, in the middle of a leg, while its wheels stand.
    restart : (leg, angle), rad
        Both readings fall by an angle in the middle of a leg.
    counts : (right, left)
        Factors on the readings.
    encoder_step : rad, optional
        Of the encoders, instead of the drive's.
    """

    eccentric: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    backward: float = 0.0
    outer: float = 0.0
    backlash: float = 0.0
    scrub: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift: float = 0.0
    slip: float = 3e-4
    slip_spread: float = 0.0
    slipped: tuple[int, float, float] | None = None
    carried: tuple[int, float, float, float] | None = None
    restart: tuple[int, float] | None = None
    counts: tuple[float, float] = (1.0, 1.0)
    encoder_step: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraFaults:
    """Departures of the camera from one model on one rigid mounting with one clock.

    Attributes
    ----------
    knocked : (stop, (6,)), rad and m
        From a stop on the camera sits elsewhere: right perturbation of ``T_body_cam`` (rotation, translation).
    focus : (stop, scale, right, down), 1 and px
        From a stop on the image is larger by a factor about its centre, and shifted.
    autofocus
        Relative standard deviation of the focal length from stop to stop.
    late, drift : s, s/s
        How late the images' stamps are, at the first stop, and how much later each second.
    lens : (k2, p1, p2, k3)
        Further coefficients of the Brown model.
    fisheye : (k1, k2, k3, k4), optional
        Equidistant camera of these coefficients (OpenCV's), instead of the robot's.
    noise, shift, spread : px
        Standard deviations: of each coordinate, and common to one stop: of the image's shift and of the tags' black.
    side_light : px
        Shift to the right of all corners of face 0, lit from one side; less on the others, as they face that light.
    """

    knocked: tuple[int, tuple[float, float, float, float, float, float]] | None = None
    focus: tuple[int, float, float, float] | None = None
    autofocus: float = 0.0
    late: float = 0.0
    drift: float = 0.0
    lens: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    fisheye: tuple[float, float, float, float] | None = None
    noise: float = 0.05
    shift: float = 0.0
    spread: float = 0.0
    side_light: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxFaults:
    """Departures of the built box from its description.

    Attributes
    ----------
    order
        Sheet that each face carries.
    turned
        Sheets glued upside down.
    scale : (x, y)
        Size of the prints against the description.
    face_scale : (FACES,)
        Size of each face's print against that of the others.
    place : (FACES, 3), m and rad
        How far each sheet lies to the right and up, and how far it is turned (anticlockwise) on its face.
    pose : (FACES, 6), rad and m
        Right perturbation (rotation, translation) of each face.
    bow : (FACES,), m
        Outward sagitta of each face, a parabola over its width.
    moved : (stop, x, y, heading), m and rad
        Displacement of the box, in its own frame, before a stop.
    standing : (4, 4), optional
        Pose of the box' frame on the floor, where it does not stand upright on it.
    other
        Another box that carries the same tags.
    """

    order: tuple[int, ...] = tuple(range(FACES))
    turned: tuple[int, ...] = ()
    scale: tuple[float, float] = (1.0, 1.0)
    face_scale: tuple[float, ...] = (1.0,) * FACES
    place: Array | None = None
    pose: Array | None = None
    bow: tuple[float, ...] = (0.0,) * FACES
    moved: tuple[int, float, float, float] | None = None
    standing: Array | None = None
    other: Box | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Imperfections:
    """All that is not exact in one drive.

    Attributes
    ----------
    wheels, camera, box
        By part.
    lean : rad
        Standard deviation of roll and of pitch from stop to stop.
    tilt : (2,), rad
        Slope of the floor against the box' base about x and y.
    """

    wheels: WheelFaults = WheelFaults()
    camera: CameraFaults = CameraFaults()
    box: BoxFaults = BoxFaults()
    lean: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
