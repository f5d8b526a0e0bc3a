"""Step 3, taken before step 2: the rotation axis seen by the camera, and signed turns (section 3.3, eqs. 24-27)."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import hat
from boxcal.target.arrays import Array

MIN_TURN_DEG = 10.0
"""The largest turn between stops must reach this: the axis' error grows as one over it."""
STRAIGHT_DOWN = 1e-4
"""Below this sin a2 the camera looks straight up or down and only a1 + a3 (or a1 - a3) is determined: a3 = 0 then."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisStep:
    """Result of step 3: direction of the vertical in the camera, and signed turns.

    Attributes
    ----------
    n_cam : (3,)
        The vertical, up, in frame ``cam``: the axis of every relative rotation.
    a2, a3 : rad
        Of ``R_body_cam = Rz(a1) Ry(a2) Rz(a3)`` (eq. 12).
    theta : (P, P), rad
        Signed turns modulo a full turn, ``theta[i, j] = theta_i - theta_j`` in (-pi, pi].
    up_error : rad
        Angle between the axis and the box's own vertical (mean over the stops): a box that leans, or wrong landmarks.
    notes
        What is not determined.
    """

    n_cam: Array
    a2: float
    a3: float
    theta: Array
    up_error: float
    notes: tuple[str, ...] = ()


def find_axis(T_cam_box: Array) -> AxisStep:
    """Return the vertical in the camera's frame, and the turns about it.

    The robot turns about the vertical only, so ``R_camj_cami = R_body_cam^T Rz(theta_i - theta_j) R_body_cam``
    (eqs. 10-14): the axis n is the unit vector that minimises ``sum |(R_camj_cami - I) n|^2``, the last right
    singular vector of the stack. Over all pairs that sum is a constant less ``|S^T n|^2`` with S the sum of
    ``R_camj_box``: n is the first left singular vector of S. Pairs with small turns weigh little by themselves, and
    half a turn is no special case, unlike in eqs. 24-25.

    Parameters
    ----------
    T_cam_box : (P, 4, 4), m
        The camera's poses.

    Raises
    ------
    CalibError
        If no two stops differ by a turn of at least ``MIN_TURN_DEG``.
    """
    R = T_cam_box[:, :3, :3]
    n = np.linalg.svd(R.sum(axis=0))[0][:, 0]
    up = R[:, :, 2]
    if np.sum(up @ n) < 0:
        n = -n
    flat = R.reshape(-1, 9)
    theta = np.arctan2((hat(n) @ R).reshape(-1, 9) @ flat.T, flat @ flat.T - 1)  # twice sine and cosine
    largest = float(np.degrees(np.abs(theta).max()))
    if largest < MIN_TURN_DEG:
        raise CalibError(
            f"largest turn between stops is {largest:.1f} deg, the camera's mounting needs {MIN_TURN_DEG:.0f} deg",
            remedy="add stops that face the box from other sides (the drive was a pure translation)",
        )
    sin_a2 = float(np.hypot(n[0], n[1]))
    a2 = float(np.arctan2(sin_a2, n[2]))
    notes: tuple[str, ...] = ()
    if sin_a2 < STRAIGHT_DOWN:
        a3 = 0.0
        notes = (f"the camera looks straight {'down' if n[2] < 0 else 'up'}: a3 is set to 0, a1 holds both",)
    else:
        a3 = float(np.arctan2(n[1], -n[0]))
    mean_up = up.mean(axis=0)
    up_error = float(np.arctan2(np.linalg.norm(np.cross(mean_up, n)), mean_up @ n))
    return AxisStep(n_cam=n, a2=a2, a3=a3, theta=theta, up_error=up_error, notes=notes)
