"""``fleet-cameras.csv`` and ``fleet-camera-pairs.csv``: one line a camera, and one a pair, of robots with several."""

from collections.abc import Iterable, Iterator, Mapping

from boxcal.calib.exports.fleet_csv import COLUMNS, cell, values_of
from boxcal.calib.exports.text import number
from boxcal.calib.geometry.euler import quaternion
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import MOUNTING
from boxcal.calib.results.each_camera import each_camera
from boxcal.calib.results.rig import CameraPair, RigCamera

_WHEELS = frozenset({"rR_m", "rL_m", "b_m", "sigma_rR_m", "sigma_rL_m", "sigma_b_m"})
_FIRST, _LAST = list(COLUMNS).index("stops"), list(COLUMNS).index("straight_position_m")
CAMERA_COLUMNS: Mapping[str, str] = {
    "robot": "name, as its log's",
    "camera": "name, made of its topic",
    "topic": "of its images",
    "frame": "that its images name",
    "verdict": "on this camera: good, usable or redo",
    "why": "causes of a verdict that is not good",
    "width_px": "of its images",
    "height_px": "",
    "clock_offset_s": "by how much its stamps were ahead of the wheels'",
    **{name: text for name, text in list(COLUMNS.items())[_FIRST:_LAST] if name not in _WHEELS},
}
"""Name of each column of the cameras' table, with its meaning and unit."""
PAIR_COLUMNS: Mapping[str, str] = {
    "robot": "name, as its log's",
    "from": "camera in whose frame the other's place and orientation are",
    "to": "the other camera",
    "x_m": "place of the other camera: to the right of the first, m (T_from_to)",
    "y_m": "below it, m",
    "z_m": "in front of it, m",
    "qx": "orientation of the other's optical frame in the first's, quaternion",
    "qy": "",
    "qz": "",
    "qw": "",
    "distance_m": "between the two, m",
    "angle_rad": "of the rotation between the two, rad",
    **{f"sigma_{n}_rad": "standard deviation, about the other camera's axes" for n in MOUNTING[:3]},
    **{f"sigma_{n}_m": "standard deviation, along the first camera's axes" for n in MOUNTING[3:]},
}
"""Name of each column of the pairs' table, with its meaning and unit."""
TEXTS = frozenset({"robot", "camera", "topic", "frame", "verdict", "why", "camera_model", "from", "to"})
"""Columns of text; the others hold numbers."""


def camera_lines(calibrations: Iterable[Calibration]) -> Iterator[dict[str, str]]:
    """Yield a row for each camera of each robot with several, by column; no text can be a formula."""
    for c in calibrations:
        cameras = each_camera(c)
        if c.rig is not None and len(cameras) > 1:
            for one, camera in zip(cameras, c.rig.cameras, strict=True):
                yield values_of(one) | _named(c.robot, camera)


def pair_lines(calibrations: Iterable[Calibration]) -> Iterator[dict[str, str]]:
    """Yield a row for each pair of cameras of each robot with several, by column."""
    for c in calibrations:
        if c.rig is not None:
            yield from (_pair(c.robot, pair) for pair in c.rig.pairs)


def _named(robot: str, camera: RigCamera) -> dict[str, str]:
    texts = {"robot": robot, "camera": camera.name, "topic": camera.topic, "frame": camera.frame}
    texts |= {"verdict": camera.verdict, "why": camera.why}
    width, height = camera.image_size
    numbers = {"width_px": str(width), "height_px": str(height), "clock_offset_s": number(camera.clock_offset)}
    return {name: cell(text) for name, text in texts.items()} | numbers


def _pair(robot: str, pair: CameraPair) -> dict[str, str]:
    R, t = pair.T_a_b[:3, :3], pair.T_a_b[:3, 3]
    values = [*t.tolist(), *quaternion(R), pair.distance[0], pair.angle[0]]
    values += [pair.sigma[name] for name in MOUNTING]
    names = list(PAIR_COLUMNS)[3:]
    texts = {"robot": cell(robot), "from": cell(pair.a), "to": cell(pair.b)}
    return texts | {name: number(value) for name, value in zip(names, values, strict=True)}
