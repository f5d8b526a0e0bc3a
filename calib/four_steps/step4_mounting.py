"""Step 4: a1, tx, ty and rL, then rR and b; and tz from the floor (section 3.4, eqs. 28-36)."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.diff_drive import stop_pairs
from boxcal.calib.geometry.so3_se3 import inverse, rigid, rot_y, rot_z
from boxcal.target.arrays import Array

MIN_RANK_RATIO = 1e-3
"""Smallest sigma4/sigma3: below it the moves leave more than one solution (the appendix' rank condition)."""
MAX_RMS = 0.5
"""Largest residual of the solution, relative to the distances moved (both root mean square)."""
_PARAMETERS = ("rL", "tx", "ty", "cos a1", "sin a1")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountingStep:
    """Result of step 4: camera extrinsics, wheel radii and wheel separation.

    Attributes
    ----------
    rR, rL, b : m
        Wheel radii and wheel separation.
    a1 : rad
        The third angle of the mounting.
    tx, ty : m
        Translation of the mounting.
    singular_values : (5,)
        Of the stacked equations, descending.
    rms : m
        Root mean square over the pairs of what the solution leaves of the equations: odometry less camera.
    """

    rR: float
    rL: float
    b: float
    a1: float
    tx: float
    ty: float
    singular_values: Array
    rms: float

    @property
    def null_ratio(self) -> float:
        """sigma5/sigma4: how well one solution fits (0 in the ideal)."""
        return float(self.singular_values[4] / self.singular_values[3])

    @property
    def rank_ratio(self) -> float:
        """sigma4/sigma3: how well the moves determine it (about 0.7 in the paper's drives)."""
        return float(self.singular_values[3] / self.singular_values[2])


def solve_mounting(*, beta: Array, theta: Array, u: Array, aR: float, aL: float) -> MountingStep:
    """Return wheels and planar mounting from the null space of the planar part of eq. 8 (eqs. 30-36).

    Every pair of stops (i, j) gives two rows,
    ``[R2 beta | I - R2 | [[ux, -uy], [uy, ux]]] . [rL, tx, ty, cos a1, sin a1] = 0`` with
    ``R2 = R(theta_i - theta_j)`` and ``u = (Ry(a2) Rz(a3) t_camj_cami)_xy``. The right singular vector of the
    smallest singular value, scaled to ``cos^2 + sin^2 = 1``, is the solution; its sign makes rL positive.

    Parameters
    ----------
    beta : (N, 2)
        Displacement of stop j in the frame of stop i, in units of rL (eq. 28).
    theta : (N,), rad
        Turns ``theta_i - theta_j``.
    u : (N, 2), m
        Translations of ``T_camj_cami`` turned upright by a2 and a3.
    aR, aL
        From step 2.

    Raises
    ------
    CalibError
        If the rank is too small: the message names what the drive does not determine.
    """
    _, singular, Vt = np.linalg.svd(np.linalg.qr(mounting_equations(beta, theta, u), mode="r"))
    _check_rank(singular, Vt)
    scale = np.hypot(Vt[-1, 3], Vt[-1, 4])
    v = Vt[-1] / scale
    rms = float(singular[4] / scale / np.sqrt(len(u)))
    rL, tx, ty, cosine, sine = (float(x) for x in (v if v[0] > 0 else -v))
    rR = -(aR / aL) * rL
    return MountingStep(
        rR=rR,
        rL=rL,
        b=rR / aR,
        a1=float(np.arctan2(sine, cosine)),
        tx=tx,
        ty=ty,
        singular_values=singular,
        rms=rms,
    )


def mounting_equations(beta: Array, theta: Array, u: Array) -> Array:
    """Return the rows, (2 N, 5), that wheels and planar mounting solve for N pairs of stops; see above."""
    c, s = np.cos(theta), np.sin(theta)
    one = np.ones_like(c)
    first = np.stack([c * beta[:, 0] - s * beta[:, 1], one - c, s, u[:, 0], -u[:, 1]], axis=1)
    second = np.stack([s * beta[:, 0] + c * beta[:, 1], -s, one - c, u[:, 1], u[:, 0]], axis=1)
    return np.concatenate([first, second])


def check_agreement(step: MountingStep, u: Array) -> None:
    """Refuse a solution that explains too little of how the camera moved, u (N, 2), m.

    Raises
    ------
    CalibError
        If its residual exceeds ``MAX_RMS`` of the distances moved.
    """
    moved = float(np.sqrt(np.mean(np.sum(u**2, axis=1))))
    if step.rms > MAX_RMS * moved:
        raise CalibError(
            f"wheels and images do not agree on any calibration (they differ by {step.rms:.3f} m where the camera "
            f"moved {moved:.3f} m): strong slip, a robot lifted, or a box moved during the drive",
            remedy="drive again",
        )


def upright_translations(T_cam_box: Array, a2: float, a3: float) -> Array:
    """Return ``u = (Ry(a2) Rz(a3) t_camj_cami)_xy`` for pairs i < j of poses (P, 4, 4): (N, 2), m."""
    upright = (rot_y(a2) @ rot_z(a3))[:2]
    j_i = upright @ T_cam_box[:, :3, :3] @ inverse(T_cam_box)[:, :3, 3].T  # (P, 2, P), t_camj_cami less t_camj_box
    i, j = stop_pairs(len(T_cam_box))
    return np.asarray(j_i[j, :, i] + (T_cam_box[:, :3, 3] @ upright.T)[j])


def stand_on_floor(step: MountingStep, T_cam_box: Array, a2: float, a3: float) -> Array:
    """Return ``T_body_cam`` (4, 4), m: tz, which eq. 8 leaves open, puts the body's origin on the floor z = 0."""
    tz = float(np.mean(inverse(T_cam_box)[:, 2, 3]))
    return rigid(rot_z(step.a1) @ rot_y(a2) @ rot_z(a3), np.array([step.tx, step.ty, tz]))


def _check_rank(singular: Array, Vt: Array) -> None:
    s3, s4 = singular[2:4]
    if s4 < MIN_RANK_RATIO * s3:
        free = [name for name, v in zip(_PARAMETERS, np.abs(Vt[-2:]).max(axis=0), strict=True) if v > 0.3]
        raise CalibError(
            f"the moves do not determine {', '.join(free)} (sigma4/sigma3 = {s4 / s3:.1e}, {MIN_RANK_RATIO:g} is "
            "needed)",
            remedy="add legs that both turn and drive on, with different curvature",
        )
