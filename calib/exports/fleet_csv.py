"""``fleet.csv``: one line a robot, for spreadsheets."""

import csv
import io
from collections.abc import Iterable

from boxcal.calib.exports.text import number
from boxcal.calib.geometry.euler import quaternion
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.results.calibration import Calibration

_UNIT = dict(zip(ORDER, ["_px"] * 4 + [""] + ["_m"] * 3 + ["_rad"] * 3 + ["_m"] * 3, strict=True))
_COMMENT = (
    "boxcal fleet; lines that begin with # are comments",
    "T_body_cam (x_m ... qw) maps camera points (x right; y down; z forward) to the body (on the floor below the "
    "middle of the axle; x forward; y left; z up); yaw to the left; pitch down; roll",
    "sigma_: standard deviations; empty if not estimated; inf if the drive does not determine them; rx ry rz about the "
    "camera's axes; straight_: error after 10 m straight ahead; turn_: after one turn on the spot",
)
_FORMULA = tuple("=+-@\uff1d\uff0b\uff0d\uff20")
_HEADER = (
    ["robot", "stops", "landmarks", "reprojection_rms_px", "fu_px", "fv_px", "cu_px", "cv_px", "kr", "rR_m", "rL_m"]
    + ["b_m", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "yaw_rad", "pitch_rad", "roll_rad"]
    + [f"sigma_{name}{_UNIT[name]}" for name in ORDER]
    + ["straight_position_m", "straight_heading_rad", "turn_heading_rad", "notes", "created", "version"]
)


def fleet_csv(calibrations: Iterable[Calibration]) -> bytes:
    """Return the table of a fleet (RFC 4180, UTF-8); no cell of text can be a formula."""
    out = io.StringIO()
    out.writelines(f"# {line}\r\n" for line in _COMMENT)
    writer = csv.writer(out)
    writer.writerow(_HEADER)
    for calibration in calibrations:
        writer.writerow(_row(calibration))
    return out.getvalue().encode("utf-8", "replace")


def cell(text: str) -> str:
    """Return text for a cell: on one line, never a formula or a comment."""
    line = "".join(c if c.isprintable() else " " for c in text)
    return f"'{line}" if line.lstrip().startswith((*_FORMULA, "#")) else line


def _row(c: Calibration) -> list[str]:
    k, w, t, R = c.camera, c.wheels, c.T_body_cam[:3, 3], c.T_body_cam[:3, :3]
    values = [c.quality.reprojection_rms_px, k.fu, k.fv, k.cu, k.cv, k.kr, w.rR, w.rL, w.b, *t]
    values += [*quaternion(R), *c.yaw_pitch_roll]
    if c.detail is None:
        sure = [""] * (len(ORDER) + 3)
    else:
        sigma, ground = c.detail.covariance.sigma, c.detail.ground
        sure = [number(sigma[name]) for name in ORDER]
        sure += [number(v) for v in (ground.straight_position, ground.straight_heading, ground.turn_heading)]
    texts = [cell("; ".join(c.notes)), cell(c.provenance.created), cell(c.provenance.version)]
    return [cell(c.robot), str(c.quality.stops), str(c.quality.landmarks), *map(number, values), *sure, *texts]
