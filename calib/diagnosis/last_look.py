"""Plausibility checks of a solution that fits well: units, heights, another box, another clock."""

import numpy as np

from boxcal.calib.diagnosis.clock import clock_finding, moving_pictures
from boxcal.calib.diagnosis.counters import WRAPS, counter_finding
from boxcal.calib.diagnosis.described_direction import elsewhere_than_described
from boxcal.calib.diagnosis.described_height import unlike_described
from boxcal.calib.diagnosis.first_look import LAYOUT_RMS_PX, FirstLook
from boxcal.calib.diagnosis.joint_units import judge_units
from boxcal.calib.diagnosis.layout import other_layout
from boxcal.calib.diagnosis.rejected_tags import rejected_finding
from boxcal.calib.diagnosis.standing import below_axle, below_floor
from boxcal.calib.diagnosis.uneven_floor import uneven_floor
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.log.wheel_samples import JointUnit


def last_look(look: FirstLook, found: Estimate) -> tuple[Finding, ...]:
    """Return what is said of an estimate that is too odd to be used as it is.

    Parameters
    ----------
    look
        The drives that it was made from.
    found
        The estimate.
    """
    out: list[Finding | None] = []
    units = look.drives[0].units
    out += [counter_finding(drive.wheels, WRAPS) for drive in look.drives]
    if units.unit is not JointUnit.METRES and all(f is None for f in out):
        steps = look.drives[0].wheels.encoder_steps
        raw = (steps[0] / abs(units.factors[0]), steps[1] / abs(units.factors[1]))
        out.append(judge_units(found.rR, found.rL, found.b, raw))
    cameras = np.concatenate([d.T_box_body @ found.T_body_cam for d in found.drives])
    low = below_floor(cameras)
    if low is None and all(f is None for f in out):
        height = float(np.median(cameras[:, 2, 3]))
        sources = [drive.source for drive in look.drives if drive.source.nominal_T_base_cam]
        low = below_axle(height, min(found.rR, found.rL))
        if low is None and sources:
            low = unlike_described(height, max(found.rR, found.rL), sources[0])
            out.append(elsewhere_than_described(found.T_body_cam, sources[0]))
    out.append(low)
    rms_px = max(step.camera.rms_px for step in look.steps)
    if rms_px > LAYOUT_RMS_PX:
        out.append(other_layout([stop for drive in look.drives for stop in drive.stops], look.target))
    out.append(rejected_finding([stop for drive in look.drives for stop in drive.stops]))
    if not any(drive.on_the_move for drive in look.drives):
        out.append(uneven_floor(found))
    out += [clock_finding(None, moving_pictures(drive), len(drive.stops)) for drive in look.drives]
    return tuple(f for f in out if f is not None)
