"""Clock offset between camera and wheels, estimated from images that move while the wheels stand.

The stamps of the images are shifted against the wheels until turns seen and turns rolled agree.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import solve_motion
from boxcal.calib.four_steps.step1_camera import CameraStep
from boxcal.calib.four_steps.step2_heading import unwrap_turns
from boxcal.calib.four_steps.step3_axis import find_axis
from boxcal.calib.four_steps.step4_mounting import upright_translations
from boxcal.calib.geometry.diff_drive import Legs
from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Index

LONGEST_S = 60.0
"""Offsets up to this are tried."""
MOVES_PX = 2.0
"""Images whose corners scatter more than this (median, one axis) were not taken by a camera that stood still."""
MOVING_SHARE = 4
"""One stop in this many with a moving image makes the clocks suspect; one of three, and two at least, forbid use."""
LEAST_STOPS = 6
"""With fewer stops an offset is not looked for: some offset always fits."""
FITS_DEG = 4.0
"""Turns agree to this (root mean square) where an offset fits."""
GAIN = 4.0
"""And this many times better than without an offset."""
MAX_RMS = 0.05
"""Places agree to this fraction of the distances moved where an offset fits."""
_COARSE_S, _FINE_S = 0.5, 0.1
"""A robot stands for a second and more at each stop, so that offsets need not be tried more closely."""
_PLATEAU_S = 1.5
_CANDIDATES = 12
_NEAR = 3
_ALIKE = 0.5
_LEAST_RAD = 0.1
"""Wheel travel below which two images are taken to show one place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockOffset:
    """Delay of the images' stamps against the wheels'.

    Attributes
    ----------
    late_s : s
        Stamp less true time.
    rms_deg, as_stamped_deg : deg
        What turns seen and rolled differ by with that offset, and without.
    """

    late_s: float
    rms_deg: float
    as_stamped_deg: float


def moving_pictures(drive: Correspondences) -> tuple[int, ...]:
    """Return the stops, from 0, whose images move while the wheels stand."""
    scatter = [
        float(np.sqrt(np.median(np.trace(stop.cov_px2, axis1=1, axis2=2)) / 2)) if len(stop.cov_px2) else 0.0
        for stop in drive.stops
    ]
    return tuple(j for j, s in enumerate(scatter) if s > MOVES_PX)


def find_offset(drive: Correspondences, camera: CameraStep) -> ClockOffset | None:
    """Return the offset of the images' stamps under which images and wheels agree on rotations; None if none does."""
    if len(camera.kept) < LEAST_STOPS:
        return None
    try:
        theta = find_axis(camera.T_cam_box).theta
    except CalibError:
        return None
    i, j = np.triu_indices(len(theta), 1)
    near = j - i <= _NEAR
    i, j = i[near], j[near]
    turn = wrap(-theta[i, j])
    middle = np.array([(drive.stops[k].t_start_ns + drive.stops[k].t_end_ns) / 2 for k in camera.kept])

    def rms(late: float) -> float:
        return turns_misfit(drive, middle - late * 1e9, turn, (i, j))

    coarse = np.arange(-LONGEST_S, LONGEST_S + _COARSE_S, _COARSE_S)
    cost = np.array([rms(late) for late in coarse])
    tried = [(_misfit(drive, camera, middle - late * 1e9), late) for late in coarse[np.argsort(cost)[:_CANDIDATES]]]
    residual, late = min(tried)
    if residual >= MAX_RMS:
        return None
    fine = late + np.arange(-_PLATEAU_S, _PLATEAU_S + _FINE_S, _FINE_S)
    cost = np.array([rms(x) for x in fine])
    least, here = float(cost.min()), rms(0.0)
    if least > np.radians(FITS_DEG) or here < GAIN * least:
        return None
    late = float(np.mean(fine[cost < 2 * least]))  # while the robot stands, stamps do not matter
    return ClockOffset(late_s=late, rms_deg=float(np.degrees(least)), as_stamped_deg=float(np.degrees(here)))


def clock_finding(offset: ClockOffset | None, moving: tuple[int, ...], stops: int) -> Finding | None:
    """Return what is said of the clocks; None if nothing speaks against one clock.

    Parameters
    ----------
    offset
        From :func:`find_offset`.
    moving
        From :func:`moving_pictures`.
    stops
        How many stops there are.
    """
    advice = (
        "Stamp camera and wheels with one clock (synchronise the computers, or stamp on arrival), and record again."
    )
    if offset is not None:
        side = "late" if offset.late_s > 0 else "early"
        return Finding(
            cause="clock",
            text=f"the camera's stamps are {abs(offset.late_s):.2f} s {side} against the wheels' (with that, rotations "
            f"by images and wheels agree to {offset.rms_deg:.1f} deg, as stamped to {offset.as_stamped_deg:.0f} deg)",
            advice=advice,
            blocks=True,
            stops=moving,
            size=offset.late_s,
            sigma=_COARSE_S / 2,
            unit="s",
        )
    if not moving or len(moving) < stops // MOVING_SHARE:
        return None
    of = f"at {len(moving)} of {stops} stops" if len(moving) > 1 else f"at stop {moving[0] + 1} of {stops}"
    text = (
        f"{of} the picture moves while the wheels stand: the stamps of camera and wheels do not fit together, or "
        "something moves the camera or the box"
    )
    if moving[0] > 0 and len(moving) > 1 and moving == tuple(range(moving[0], stops)):
        text = (
            f"from stop {moving[0] + 1} of {stops} on the picture moves while the wheels stand, as where the clocks of "
            "camera and wheels drift apart"
        )
    return Finding(cause="clock", text=text, advice=advice, blocks=len(moving) >= max(2, stops // 3), stops=moving)


def _misfit(drive: Correspondences, camera: CameraStep, t_ns: Array) -> float:
    """Return what places differ by if images were taken at times (P,), as a fraction of the distances moved."""
    w = drive.wheels
    parts, ends = [], [0]
    for a, b in pairwise(t_ns):
        inner = w.t_ns[(w.t_ns > a) & (w.t_ns < b)]
        t = np.concatenate([[a], inner, [b]])
        parts.append(np.diff(np.stack([np.interp(t, w.t_ns, w.phi_R), np.interp(t, w.t_ns, w.phi_L)], axis=1), axis=0))
        ends.append(ends[-1] + len(parts[-1]))
    dphi = np.concatenate(parts)
    try:
        steps = solve_motion(camera, Legs(dphi_R=dphi[:, 0], dphi_L=dphi[:, 1], ends=tuple(ends)))
    except (CalibError, np.linalg.LinAlgError):
        return float("inf")
    u = upright_translations(camera.T_cam_box, steps.axis.a2, steps.axis.a3)
    return float(steps.mounting.rms / np.sqrt(np.mean(np.sum(u**2, axis=1))))


def turns_misfit(drive: Correspondences, t_ns: Array, turn: Array, pairs: tuple[Index, Index]) -> float:
    """Return what turns seen and rolled differ by if images were taken at times (P,), rad; inf if no wheels fit.

    Before and after the record the robot is taken to stand.
    """
    left = turns_left(drive, t_ns, turn, pairs)
    return float("inf") if left is None else float(np.sqrt(np.nanmean(left**2)))


def turns_left(
    drive: Correspondences, t_ns: Array, turn: Array, pairs: tuple[Index, Index], worst: float = 0.0
) -> Array | None:
    """Return turns seen less turns rolled if images were taken at times (P,), rad, NaN where hardly anything rolled.

    None if no wheels fit. The wheels are those that fit all turns but the ``worst`` fraction of them.
    """
    w = drive.wheels
    phi = np.stack([np.interp(t_ns, w.t_ns, w.phi_R), np.interp(t_ns, w.t_ns, w.phi_L)], axis=1)
    i, j = pairs
    moved = phi[j] - phi[i]
    some = np.abs(moved).sum(axis=1) > _LEAST_RAD
    if np.count_nonzero(some) < LEAST_STOPS:
        return None
    moved = moved[some]
    singular = np.linalg.svd(moved, compute_uv=False)
    if singular[1] < 1e-3 * singular[0]:
        return None
    dtheta = unwrap_turns(turn[some], moved)
    a, *_ = np.linalg.lstsq(moved, dtheta, rcond=None)
    if worst > 0:
        kept = np.argsort(np.abs(dtheta - moved @ a))[: max(round((1 - worst) * len(moved)), LEAST_STOPS)]
        a, *_ = np.linalg.lstsq(moved[kept], dtheta[kept], rcond=None)
    if not (a[0] > 0 > a[1]) or abs(np.log(-a[0] / a[1])) > _ALIKE:
        return None
    out = np.full(len(turn), np.nan)
    out[some] = dtheta - moved @ a
    return out
