"""A result without what grows with its drive, so that a whole fleet's fit into memory."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Covariance
from boxcal.calib.results.rig import Rig
from boxcal.calib.results.verdict import Kind, Level, Reason

_KEPT = ("hardware",)
"""Settings that a fleet is sorted by."""


def without_drive(calibration: Calibration) -> Calibration:
    """Return a result of some 10 kB, whatever the number of stops, legs and frames.

    Left are parameters and their covariance, goodness of fit, noise, notes, causes, verdict, inputs, of the stops the
    first and the last, and of checks that were passed their rules. What only the robot's own file and report say is
    gone: the other stops, legs, rejected corners, held-out stops, growth, settings but for those of ``_KEPT`` and the
    covariance of the camera model's further coefficients.
    """
    detail = calibration.detail
    if detail is not None:
        detail = replace(
            detail,
            covariance=_shared_names(detail.covariance) or detail.covariance,
            camera_covariance=None,
            legs=(),
            flagged_corners=(),
            held_out=(),
            growth=(),
            leave_one_out=None,
            extra=_interned(detail.extra),
            extra_sigma=_interned(detail.extra_sigma),
            effects=_interned(detail.effects),
        )
    settings = calibration.provenance.settings
    origin = replace(calibration.provenance, settings={name: settings[name] for name in _KEPT if name in settings})
    ends = calibration.stops[:: max(len(calibration.stops) - 1, 1)][:2]
    verdict = calibration.verdict
    if verdict is not None:
        verdict = replace(
            verdict, headline=sys.intern(verdict.headline), reasons=tuple(_shared(r) for r in verdict.reasons)
        )
    rig = None if calibration.rig is None else _with_shared_names(calibration.rig)
    return replace(calibration, stops=ends, verdict=verdict, detail=detail, provenance=origin, rig=rig)


def _with_shared_names(rig: Rig) -> Rig:
    """Return a robot's cameras with covariances whose names take memory once."""
    return replace(rig, cameras=tuple(replace(c, covariance=_shared_names(c.covariance)) for c in rig.cameras))


def _shared_names(covariance: Covariance | None) -> Covariance | None:
    return covariance if covariance is None or covariance.names != ORDER else replace(covariance, names=ORDER)


def _shared(reason: Reason) -> Reason:
    """Return a reason without the sentence of a passed check; what many robots have in common takes memory once."""
    if reason.level is Level.GOOD and reason.kind is Kind.CHECK:
        return _passed(reason.rule)
    return replace(reason, rule=sys.intern(reason.rule), advice=sys.intern(reason.advice))


@cache
def _passed(rule: str) -> Reason:
    return Reason(rule=rule, level=Level.GOOD, text="")


def _interned(values: Mapping[str, float]) -> dict[str, float]:
    """Return values whose names take memory once, however many robots have them."""
    return {sys.intern(name): value for name, value in values.items()}
