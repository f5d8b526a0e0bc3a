"""Results as plain tables, for people who read them in a terminal."""

import numpy as np

from boxcal.calib.compare.ground_truth import Errors
from boxcal.calib.geometry.so3_se3 import exp_so3
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import ORDER
from boxcal.target.arrays import Array

_DIFFERENCE = 1e-6
_R_LINK_CAM = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Optical axes (x right, y down, z forward) in a frame with x forward, y left, z up."""


def yaw_pitch_roll(R_body_cam: Array) -> tuple[float, float, float]:
    """Return where the camera looks: yaw (left), pitch (down) and roll, rad, of ``Rz(yaw) Ry(pitch) Rx(roll)``.

    The rotation is that of the camera's link (x along the view, y left, z up), not of its optical frame, so a camera
    that looks straight ahead has zeros.
    """
    R = R_body_cam @ _R_LINK_CAM.T
    pitch = float(np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])))
    return float(np.arctan2(R[1, 0], R[0, 0])), pitch, float(np.arctan2(R[2, 1], R[2, 2]))


def table(header: list[str], rows: list[list[str]]) -> str:
    """Return a text table: the first column to the left, the others to the right."""
    widths = [max(len(line[k]) for line in [header, *rows]) for k in range(len(header))]
    lines = [
        "  ".join(
            cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        for line in [header, ["-" * w for w in widths], *rows]
    ]
    return "\n".join(line.rstrip() for line in lines)


def results_table(results: list[Calibration]) -> str:
    """Return wheels, mounting and focal lengths of every robot, each with its standard deviation below it."""
    header = ["robot", "stops", "landmarks", "reproj px", "rL mm", "rR mm", "b mm"]
    header += ["x mm", "y mm", "z mm", "yaw deg", "pitch deg", "roll deg", "fu px", "fv px"]
    rows = []
    for r in results:
        angles = np.degrees(yaw_pitch_roll(r.T_body_cam[:3, :3]))
        w, q, t = r.wheels, r.quality, r.T_body_cam[:3, 3] * 1e3
        rows.append(
            [r.robot, str(q.stops), str(q.landmarks), f"{q.reprojection_rms_px:.3f}"]
            + [f"{v * 1e3:.3f}" for v in (w.rL, w.rR, w.b)]
            + [f"{v:.2f}" for v in t]
            + [f"{v:.3f}" for v in angles]
            + [f"{v:.2f}" for v in (r.camera.fu, r.camera.fv)]
        )
        if r.detail is not None:
            s = r.detail.covariance.sigma
            turns = np.degrees(yaw_pitch_roll_sigma(r.T_body_cam[:3, :3], r.detail.covariance.matrix))
            rows.append(
                ["  +/-", "", "", ""]
                + [f"{1e3 * s[name]:.3f}" for name in ("rL", "rR", "b")]
                + [f"{1e3 * s[name]:.2f}" for name in ("tx", "ty", "tz")]
                + [f"{v:.3f}" for v in turns]
                + [f"{s[name]:.2f}" for name in ("fu", "fv")]
            )
    return table(header, rows)


def yaw_pitch_roll_sigma(R_body_cam: Array, cov: Array) -> Array:
    """Return the standard deviations of yaw, pitch and roll, (3,) rad, from a covariance (14, 14) in ``ORDER``.

    Infinite where the mounting's rotation is not determined.
    """
    first = ORDER.index("rx")
    turns = cov[first : first + 3, first : first + 3]
    if not np.all(np.isfinite(turns)):
        return np.full(3, np.inf)
    R = R_body_cam
    steps = np.eye(3) * _DIFFERENCE
    J = np.array([np.subtract(yaw_pitch_roll(R @ exp_so3(d)), yaw_pitch_roll(R @ exp_so3(-d))) for d in steps]).T / (
        2 * _DIFFERENCE
    )
    return np.asarray(np.sqrt(np.diag(J @ turns @ J.T)))


def errors_table(errors: list[tuple[str, Errors]]) -> str:
    """Return how far every robot's calibration is from the truth."""
    header = ["error against truth", "rL %", "rR %", "b %", "rotation deg", "x mm", "y mm", "z mm"]
    header += ["fu %", "fv %", "cu px", "cv px", "kr"]
    rows = [
        [robot]
        + [f"{100 * v:+.3f}" for v in (e.rL, e.rR, e.b)]
        + [f"{np.degrees(e.rotation):.3f}"]
        + [f"{1e3 * v:+.2f}" for v in (e.tx, e.ty, e.tz)]
        + [f"{100 * v:+.3f}" for v in (e.fu, e.fv)]
        + [f"{v:+.2f}" for v in (e.cu, e.cv)]
        + [f"{e.kr:+.4f}"]
        for robot, e in errors
    ]
    return table(header, rows)
