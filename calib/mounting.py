"""Step 4: a1, tx, ty and rL, then rR and b; and tz from the floor (section 3.4, eqs. 28-36)."""

from dataclasses import dataclass

import numpy as np

from calib.errors import CalibError
from calib.frames import Array, inverse, rigid, rot_y, rot_z
from calib.odometry import Legs, unit_path

MIN_RANK_RATIO = 1e-3
"""Smallest sigma4/sigma3: below it the moves leave more than one solution (the appendix' rank condition)."""
MAX_NULL_RATIO = 0.5
"""Largest sigma5/sigma4: above it no single solution stands out from the noise."""
_PARAMETERS = ("rL", "tx", "ty", "cos a1", "sin a1")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountingStep:
    """What step 4 returns.

    Attributes
    ----------
    rR, rL, b : m
        Wheel radii and wheelbase.
    a1 : rad
        The third angle of the mounting.
    T_body_cam : (4, 4), m
        The mounting; tz puts the body's origin on the floor.
    singular_values : (5,)
        Of the stacked equations, descending.
    """

    rR: float
    rL: float
    b: float
    a1: float
    T_body_cam: Array
    singular_values: Array

    @property
    def null_ratio(self) -> float:
        """sigma5/sigma4: how well one solution fits (0 in the ideal)."""
        return float(self.singular_values[4] / self.singular_values[3])

    @property
    def rank_ratio(self) -> float:
        """sigma4/sigma3: how well the moves determine it (about 0.7 in the paper's drives)."""
        return float(self.singular_values[3] / self.singular_values[2])


def solve_mounting(
    T_cam_box: Array, legs: Legs, *, theta: Array, a2: float, a3: float, aR: float, aL: float
) -> MountingStep:
    """Return wheels and mounting from the null space of the stacked planar part of eq. 8 (eqs. 30-36).

    Every pair of stops gives two rows,
    ``[R2 beta | I - R2 | [[ux, -uy], [uy, ux]]] . [rL, tx, ty, cos a1, sin a1] = 0`` with
    ``R2 = R(theta_i - theta_j)`` and ``u = (Ry(a2) Rz(a3) t_camj_cami)_xy``. The right singular vector of the
    smallest singular value, scaled to ``cos^2 + sin^2 = 1``, is the solution; its sign makes rL positive.

    Parameters
    ----------
    T_cam_box : (P, 4, 4), m
        The camera's poses.
    legs
        Wheel travel between the stops.
    theta : (P, P), rad
        Turns ``theta_i - theta_j``.
    a2, a3 : rad
        Of the mounting, from step 3.
    aR, aL
        From step 2.

    Raises
    ------
    CalibError
        If the rank is too small: the message names what the drive does not determine.
    """
    xy, heading = unit_path(legs, aR, aL)
    T_box_cam = inverse(T_cam_box)
    i, j = np.triu_indices(len(T_cam_box), 1)
    t_camj_cami = (T_cam_box[j] @ T_box_cam[i])[:, :3, 3]
    u = (t_camj_cami @ (rot_y(a2) @ rot_z(a3)).T)[:, :2]
    c, s = np.cos(theta[i, j]), np.sin(theta[i, j])
    dx, dy = (xy[j] - xy[i]).T
    ch, sh = np.cos(heading[i]), np.sin(heading[i])
    beta_x, beta_y = ch * dx + sh * dy, -sh * dx + ch * dy
    one = np.ones_like(c)
    first = np.stack([c * beta_x - s * beta_y, one - c, s, u[:, 0], -u[:, 1]], axis=1)
    second = np.stack([s * beta_x + c * beta_y, -s, one - c, u[:, 1], u[:, 0]], axis=1)
    _, singular, Vt = np.linalg.svd(np.concatenate([first, second]), full_matrices=False)
    _check_rank(singular, Vt)
    v = Vt[-1]
    v = v / np.hypot(v[3], v[4])
    v = v if v[0] > 0 else -v
    rL, tx, ty, a1 = float(v[0]), float(v[1]), float(v[2]), float(np.arctan2(v[4], v[3]))
    rR = -(aR / aL) * rL
    tz = float(np.mean(T_box_cam[:, 2, 3]))
    R_body_cam = rot_z(a1) @ rot_y(a2) @ rot_z(a3)
    return MountingStep(
        rR=rR, rL=rL, b=rR / aR, a1=a1, T_body_cam=rigid(R_body_cam, np.array([tx, ty, tz])), singular_values=singular
    )


def _check_rank(singular: Array, Vt: Array) -> None:
    s3, s4, s5 = singular[2:]
    if s4 < MIN_RANK_RATIO * s3:
        free = [name for name, v in zip(_PARAMETERS, np.abs(Vt[-2:]).max(axis=0), strict=True) if v > 0.3]
        raise CalibError(
            f"the moves do not determine {', '.join(free)} (sigma4/sigma3 = {s4 / s3:.1e}, {MIN_RANK_RATIO:g} is "
            "needed); add legs that both turn and drive on, with different curvature"
        )
    if s5 > MAX_NULL_RATIO * s4:
        raise CalibError(
            f"wheels and images do not agree on any calibration (sigma5/sigma4 = {s5 / s4:.2f}, below "
            f"{MAX_NULL_RATIO:g} is needed): strong slip, a robot lifted, or a box moved during the drive; drive again"
        )
