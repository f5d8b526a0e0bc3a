"""Rules on the likelihood's result: how certain the values are, what happened during the drive, how well all fits."""

import re
from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np

from boxcal.calib.assessment.limits import LIMITS, angle, graded, length, sentence
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.likelihood.estimate import Direction, FlaggedLeg
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Detail
from boxcal.calib.results.unknowns import describe
from boxcal.calib.results.verdict import Level, Reason
from boxcal.calib.uncertainty.projection import projection_sigma
from boxcal.target.camera.distortion import DISTORTION_NAMES

_GRID = 9
_MANY_SHEETS = 2
_FURTHER = re.compile(r"face\d_\w\w|bow\d|scale_[xy]|seat|ink|tilt_[xy](_\d+)?")
_DISTORTION = {"kr", *(name for names in DISTORTION_NAMES.values() for name in names)}
NAMES = {
    **dict.fromkeys(("fu", "fv"), "the focal length"),
    **dict.fromkeys(("cu", "cv"), "the principal point"),
    "kr": "the distortion",
    "rR": "the right wheel's radius",
    "rL": "the left wheel's radius",
    "b": "the wheel separation",
    **dict.fromkeys(("rx", "ry", "rz"), "the camera's direction"),
    **dict.fromkeys(("tx", "ty"), "the camera's place"),
    "tz": "the camera's height",
}
"""The reported parameters in words."""


def _open(c: Calibration, detail: Detail) -> list[Reason]:
    reasons = []
    for direction in detail.directions:
        if isfinite(direction.sigma) and (_of_a_cause(direction) or (_distortion_alone(direction) and _rays_known(c))):
            continue
        level = Level.USABLE if isfinite(direction.sigma) else Level.REDO
        reasons.append(
            Reason(rule="open", level=level, text=sentence(in_words(direction)), advice=sentence(direction.advice))
        )
    return reasons


def in_words(direction: Direction) -> str:
    """Return what is open, further unknowns by what they are instead of by their names, many of them as a few."""
    names = [name for name, _ in direction.parameters]
    of_sheets = [name for name in names if name.startswith("face")]
    if len(of_sheets) > _MANY_SHEETS and direction.what.count(",") >= len(names) - 2:
        rest = [describe(name).words for name in names if name not in of_sheets]
        known = "known badly together" if isfinite(direction.sigma) else "cannot be told apart by these stops"
        size = direction.what.rpartition(known)[2]
        verb = "are " if isfinite(direction.sigma) else ""
        parts = ["the places of the sheets", *rest]
        return f"{' and '.join(p for p in (', '.join(parts[:-1]), parts[-1]) if p)} {verb}{known}{size}"
    what = direction.what
    for name in sorted(names, key=len, reverse=True):
        what = re.sub(rf"\b{re.escape(name)}\b", describe(name).words, what) if _FURTHER.fullmatch(name) else what
    return what


def _of_a_cause(direction: Direction) -> bool:
    """Whether a direction is of an explanation's unknowns, whose priors hold them: their sigmas are in its note."""
    return "-" in direction.parameters[0][0]


def _distortion_alone(direction: Direction) -> bool:
    """Whether a direction is of distortion coefficients alone: several can be unsure together and say the same."""
    return all(name in _DISTORTION for name, _ in direction.parameters)


def _rays_known(c: Calibration) -> bool:
    return LIMITS["camera-angle"].grade(ray_sigma_deg(c)) is Level.GOOD


def ray_sigma_deg(c: Calibration) -> float:
    """Return the worst standard deviation, deg, of a pixel's ray in the camera, over the whole image."""
    width, height = c.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, _GRID), np.linspace(0, height - 1, _GRID))
    cov, n = c.projection_covariance, len(c.camera.values)
    of_camera = np.zeros_like(cov)
    of_camera[:n, :n] = cov[:n, :n]
    uv = np.column_stack([u.ravel(), v.ravel()])
    sigma = projection_sigma(c.camera, of_camera, c.T_body_cam, uv_px=uv, distance=1.0)
    worst_px = float(np.nanmax(sigma)) if np.any(np.isfinite(sigma)) else float("inf")
    return float(np.degrees(worst_px / min(abs(c.camera.fu), abs(c.camera.fv))))


def _ground(_: Calibration, detail: Detail) -> list[Reason]:
    g = detail.ground
    heading, turn = np.degrees([g.straight_heading, g.turn_heading])
    straight = "Add long straight legs (2 m and more) between stops, and stops: twice the stops, 0.7 times the error."
    return [
        *graded(
            "straight",
            g.straight_position,
            f"After 10 m straight ahead the position is off by {length(g.straight_position)}, typically.",
            straight,
        ),
        *graded(
            "heading",
            heading,
            f"After 10 m straight ahead the heading is off by {angle(heading)}, typically.",
            straight,
        ),
        *graded(
            "turn",
            turn,
            f"After a whole turn on the spot the heading is off by {angle(turn)}, typically.",
            "Add turns on the spot between stops, to the left and to the right.",
        ),
    ]


def _camera(_: Calibration, detail: Detail) -> list[Reason]:
    sigma = detail.covariance.sigma
    turned = float(np.degrees(max(sigma[name] for name in ("rx", "ry", "rz"))))
    place = max(sigma[name] for name in ("tx", "ty", "tz"))
    return [
        *graded(
            "camera-angle",
            turned,
            f"The camera's direction is known to {angle(turned)}.",
            "Add stops nearer to the box, on all its sides, with turns between them.",
        ),
        *graded(
            "camera-place",
            place,
            f"The camera's place on the robot is known to {length(place)}.",
            "Add turns of a quarter and more between stops that see the box well.",
        ),
    ]


def _legs(c: Calibration, detail: Detail) -> list[Reason]:
    """Judge the legs that were left out; one whose cause is named elsewhere is reported there, as a note."""
    count, flagged = len(detail.legs), detail.flagged_legs
    if not flagged:
        return graded("legs", 0.0, f"Wheels and images agree on all {count} legs: no slip, no pushed box.", "")
    level = LIMITS["legs"].grade(len(flagged) / max(count, 1))
    named = {finding.stops for finding in c.findings if finding.adopted}
    if level is not Level.REDO:
        flagged = tuple(leg for leg in flagged if (leg.leg, leg.next_stop) not in named)
        if not flagged:
            text = "Wheels and images agree on all legs but those left out, whose causes are known."
            return [Reason(rule="legs", level=Level.GOOD, text=text)]
    return [
        Reason(rule="legs", level=level, text=_leg_text(leg, several=_drives(detail) > 1), advice=_leg_advice(leg))
        for leg in flagged
    ]


def _drives(detail: Detail) -> int:
    return len({leg.drive for leg in detail.legs})


def _leg_text(leg: FlaggedLeg, *, several: bool) -> str:
    of_drive = f" of drive {leg.drive + 1}" if several else ""
    moved = float(np.hypot(*leg.box_moved_mm))
    causes = (
        "a wheel slipped, the robot was held or carried, or the box was pushed"
        if leg.slip_explains
        else f"the box was pushed by {moved:.0f} mm and {abs(leg.box_turned_deg):.1f}°, or the robot was "
        "carried; no slip explains it"
    )
    return (
        f"Between stops {leg.leg + 1} and {leg.next_stop + 1}{of_drive} wheels and images differ by "
        f"{leg.size_mm:.0f} mm and {abs(leg.turn_deg):.1f}°; that leg was left out. Likely {causes}."
    )


def _leg_advice(leg: FlaggedLeg) -> str:
    if leg.slip_explains:
        return "Drive slower, with gentle starts, on a dry floor without sills or cables, and do not push the robot."
    return "Fasten the box to the floor (tape will do), keep clear of it, and drive again."


def _slip(_: Calibration, detail: Detail) -> list[Reason]:
    slip = detail.noise.slip
    text = f"The wheels hold the floor: they slip by {length(slip)} over a metre."
    if slip > LIMITS["slip"].good:
        text = f"The wheels slip all along: by {length(slip)} over a metre."
    return graded("slip", slip, text, "Drive slower, with gentle starts, on a dry and even floor; clean the wheels.")


def _sharpness(c: Calibration, detail: Detail) -> list[Reason]:
    pixel = detail.noise.pixel_px
    text = f"The pictures are sharp: corners are seen to {pixel:.2f} px."
    if pixel * 640 / c.image_size[0] > LIMITS["sharpness"].good:
        text = f"The pictures are blurred or noisy: corners are seen to {pixel:.2f} px only."
    advice = "Stand still for two seconds at each stop, with more light; clean and focus the lens; then drive again."
    return graded("sharpness", pixel * 640 / c.image_size[0], text, advice)


def _fit(_: Calibration, detail: Detail) -> list[Reason]:
    factor = detail.noise.pixel_factor
    text = f"Box and lens fit what was seen: corners err {factor:.1f} times as much as they scatter."
    if factor > LIMITS["fit"].good:
        text = (
            f"Corners lie {factor:.1f} times further off than they scatter: the box is not as its description says, or "
            "the lens bends more than the model."
        )
    return graded(
        "fit",
        factor,
        text,
        "Measure the printed box (measure-target) and calibrate the same log again; if that does not help, try a "
        "richer lens.",
    )


def _corners(c: Calibration, detail: Detail) -> list[Reason]:
    fraction = len(detail.flagged_corners) / max(c.quality.landmarks, 1)
    text = f"{len(detail.flagged_corners)} of {c.quality.landmarks} corners were left out as wrong."
    return graded("corners", fraction, text, "Look for glare, dirt and damaged tags on the box; light it evenly.")


def _misfit(_: Calibration, detail: Detail) -> list[Reason]:
    """Judge what single stops and legs do to the answer: sigmas that do not trust the model."""
    found = detail.leave_one_out
    if found is None:
        return []
    worst = int(np.argmax(found.ratio))
    if not found.unexplained:
        text = "No single stop or leg moves the answer by more than noise explains."
        return [Reason(rule="misfit", level=Level.GOOD, text=text)]
    text = (
        f"Something is not as the model has it: leaving out single stops and legs moves {NAMES[ORDER[worst]]} by "
        f"{found.ratio[worst]:.0f} times what noise explains. The standard deviations are enlarged to that."
    )
    advice = (
        "Look at stops and legs in the report that do not fit; check that the camera and the box are fixed and the "
        "floor is even, then drive again."
    )
    return [Reason(rule="misfit", level=Level.USABLE, text=text, advice=advice)]


def _held_out(_: Calibration, detail: Detail) -> list[Reason]:
    ratio = held_out_ratio(detail)
    if ratio is None:
        return []
    text = f"Stops that were left out are predicted as well as claimed ({ratio:.1f} sigma)."
    if ratio > LIMITS["held-out"].good:
        text = f"Stops that were left out are predicted worse than claimed ({ratio:.1f} sigma)."
    return graded(
        "held-out", ratio, text, "Look at the worst stop and leg in the report, and drive again without them."
    )


def held_out_ratio(detail: Detail) -> float | None:
    """Return the root mean square of the held-out errors, in the sigmas that were claimed (1 in the ideal).

    Stops at the end of a leg that was left out are predicted through its fault, and do not count; None if none is left.
    """
    faulty = {(leg.drive, leg.next_stop) for leg in detail.flagged_legs}
    fair = [stop for stop in detail.held_out if (stop.drive, stop.stop) not in faulty]
    if not fair:
        return None
    errors, sigmas = np.array([stop.error for stop in fair]), np.array([stop.sigma for stop in fair])
    return float(np.sqrt(np.mean((errors / sigmas) ** 2)))


DETAIL_RULES: Sequence[Callable[[Calibration, Detail], list[Reason]]] = (
    _open,
    _ground,
    _camera,
    _legs,
    _slip,
    _sharpness,
    _fit,
    _misfit,
    _corners,
    _held_out,
)
