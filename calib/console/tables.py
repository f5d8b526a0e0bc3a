"""Results as plain tables, for people who read them in a terminal."""

import numpy as np

from boxcal.calib.results.calibration import Calibration


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
        angles = np.degrees(r.yaw_pitch_roll)
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
            turns = np.degrees(r.yaw_pitch_roll_sigma)
            rows.append(
                ["  +/-", "", "", ""]
                + [f"{1e3 * s[name]:.3f}" for name in ("rL", "rR", "b")]
                + [f"{1e3 * s[name]:.2f}" for name in ("tx", "ty", "tz")]
                + [f"{v:.3f}" for v in turns]
                + [f"{s[name]:.2f}" for name in ("fu", "fv")]
            )
    return table(header, rows)
