"""Text and table of the difference of two calibrations."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from boxcal.calib.compare.cameras import Further, chance_of_all, only_in_one
from boxcal.calib.compare.difference import STRAIGHT, Difference
from boxcal.calib.compare.ground_truth import Errors
from boxcal.calib.console.judgement import judgement, wrapped
from boxcal.calib.console.tables import MANY, shortened, table
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.log.safe_text import printable

_LARGEST = 3
_MM, _DEG = 1e3, float(np.degrees(1))
_SHOWN = (
    *(("px", 1.0, 2),) * 4,
    ("", 1.0, 5),
    *(("mm", _MM, 4),) * 3,
    *(("deg", _DEG, 3),) * 3,
    *(("mm", _MM, 2),) * 3,
)
"""Unit, factor and digits of each parameter in ``ORDER``."""


def comparison(a: Calibration, b: Calibration, found: Difference, others: Sequence[Further] = ()) -> str:
    """Return the difference of two calibrations as text, that of further cameras too, without the verdict."""
    looks = [_listed(np.degrees(c.yaw_pitch_roll).tolist()) for c in (a, b)]
    g = found.ground
    lines = [
        f"{printable(a.robot)}: A of {printable(a.provenance.created)}, B of {printable(b.provenance.created)}",
        "",
        _parameters(a, b, found),
        *_models(a, b),
        "rx, ry, rz: turn of the camera about its own axes (right, down, along the view)",
        f"camera looks (yaw to the left, pitch down, roll): A {looks[0]} deg, B {looks[1]} deg",
        "",
        f"{STRAIGHT:g} m straight ahead by A end {g.straight_position:.4f} m away by B, heading "
        f"{g.straight_heading * _DEG:+.3f} deg",
        f"one turn on the spot by A is {g.turn_heading * _DEG:+.3f} deg more by B",
        f"a point {g.distance:g} m from the camera appears {g.projection_mean_px:.2f} px away in the mean over the "
        f"image, {g.projection_worst_px:.2f} px at worst",
    ]
    if others:
        lines += ["", f"all of the above is of camera {a.rig.names[0] if a.rig is not None else ''}"]
    lines += [line for other in others for line in wrapped("", other.text)]
    lines += only_in_one(a, b)
    for which, c in (("A", a), ("B", b)):
        if c.verdict is not None and (c.verdict.causes or c.findings):
            lines += ["", judgement(which, c.verdict)]
    return "\n".join(lines)


def _models(a: Calibration, b: Calibration) -> list[str]:
    """Return why cameras are not compared by their coefficients, where they are not."""
    if a.camera.kind is b.camera.kind:
        return []
    return [f"camera models differ (A {a.camera.kind}, B {b.camera.kind}): the cameras are compared by what they see"]


def verdict(found: Difference, level: float, others: Sequence[Further] = ()) -> str:
    """Return whether chance explains the difference at a level of the test, over all cameras."""
    p_value = chance_of_all(found.p_value, others)
    if found.p_value is None or p_value is None:
        return f"{found.why_not}: chance cannot be judged"
    differ = p_value < level
    lines = [
        f"chi-square {found.chi2:.1f} of {found.dof} parameters: chance alone differs as much with probability "
        f"{found.p_value:.2g}",
        *_over_all(p_value, others),
        f"{'the calibrations differ beyond chance' if differ else 'no difference beyond chance'} at the level of "
        f"{level:g}, if they come from independent drives",
    ]
    if differ and found.sigma is not None:
        z = np.abs(found.values / found.sigma)
        lines.append("largest, in sigmas: " + ", ".join(f"{ORDER[i]} {z[i]:.1f}" for i in np.argsort(-z)[:_LARGEST]))
    return "\n".join(lines)


def _over_all(p_value: float, others: Sequence[Further]) -> list[str]:
    tests = 1 + sum(other.p_value is not None for other in others)
    return [f"over all {tests} tests, of cameras and pairs: probability {p_value:.2g}"] if tests > 1 else []


def _parameters(a: Calibration, b: Calibration, found: Difference) -> str:
    header, rows = ["parameter", "A", "B", "B - A"], []
    values = [[*_camera_and_wheels(c), *[None] * 3, *c.T_body_cam[:3, 3].tolist()] for c in (a, b)]
    for i, (name, (unit, factor, digits)) in enumerate(zip(ORDER, _SHOWN, strict=True)):
        own = ["" if v[i] is None else f"{v[i] * factor:.{digits}f}" for v in values]
        rows.append([f"{name} {unit}".rstrip(), *own, f"{found.values[i] * factor:+.{digits}f}"])
        if found.sigma is not None:
            s = float(found.sigma[i])
            known = np.isfinite(s) and s > 0
            rows[-1] += [f"{s * factor:.{digits + 1}f}", f"{found.values[i] / s:+.1f}" if known else "not determined"]
    return table([*header, "sigma", "in sigmas"] if found.sigma is not None else header, rows)


def _camera_and_wheels(c: Calibration) -> list[float]:
    k, w = c.camera, c.wheels
    return [k.fu, k.fv, k.cu, k.cv, k.kr, w.rR, w.rL, w.b]


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{v:.2f}" for v in values)


def errors_table(errors: Sequence[tuple[str, Errors]]) -> str:
    """Return how far every robot's calibration is from the truth, in two tables that fit 80 columns.

    Of more than :data:`~boxcal.calib.console.tables.MANY` robots each table has the root mean square of the errors and
    the largest ones alone.
    """
    if len(errors) > MANY:
        rms, largest = _over_all_robots([e for _, e in errors])
        errors = [(f"rms of {len(errors)}", rms), ("largest", largest)]
    wheels = [
        [shortened(robot)]
        + [f"{100 * v:+.3f}" for v in (e.rL, e.rR, e.b)]
        + [f"{np.degrees(e.rotation):.3f}"]
        + [f"{1e3 * v:+.2f}" for v in (e.tx, e.ty, e.tz)]
        for robot, e in errors
    ]
    camera = [
        [shortened(robot)]
        + [f"{100 * v:+.3f}" for v in (e.fu, e.fv)]
        + [f"{v:+.2f}" for v in (e.cu, e.cv)]
        + [f"{e.kr:+.4f}"]
        for robot, e in errors
    ]
    title = "error against truth"
    header = [title, "rL %", "rR %", "b %", "turn deg", "x mm", "y mm", "z mm"]
    return table(header, wheels) + "\n\n" + table([title, "fu %", "fv %", "cu px", "cv px", "kr"], camera)


def _over_all_robots(errors: Sequence[Errors]) -> tuple[Errors, Errors]:
    """Return the root mean square of each error, and the largest of each, with its sign."""
    each = {field.name: np.array([getattr(e, field.name) for e in errors]) for field in fields(Errors)}
    rms = {name: float(np.sqrt((of**2).mean())) for name, of in each.items()}
    return Errors(**rms), Errors(**{name: float(of[np.abs(of).argmax()]) for name, of in each.items()})
