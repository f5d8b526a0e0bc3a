"""All continuous causes that are considered for a drive."""

from boxcal.calib.diagnosis.backlash import Backlash
from boxcal.calib.diagnosis.backward import Backward
from boxcal.calib.diagnosis.camera_knocked import CameraKnocked
from boxcal.calib.diagnosis.cause import Cause, Reference
from boxcal.calib.diagnosis.eccentric import Eccentric
from boxcal.calib.diagnosis.focus import FocusChanged, FocusVaries
from boxcal.calib.diagnosis.outer import Outer
from boxcal.calib.diagnosis.scrub import Scrub
from boxcal.calib.likelihood.fit import Fit, Tested


def of_wheels(fit: Tested) -> tuple[Cause, ...]:
    """Return the causes in the wheels that may be at work in a drive."""
    at = Reference.of(fit.state)
    return (
        Eccentric(wheels=(0,), at=at),
        Eccentric(wheels=(1,), at=at),
        Eccentric(wheels=(0, 1), at=at),
        Backward(at=at),
        Outer(at=at),
        Backlash(at=at),
        Scrub(at=at),
        Scrub(at=at, parts=("spot",)),
        Scrub(at=at, parts=("side", "drift")),
    )


def candidates(fit: Fit) -> tuple[Cause, ...]:
    """Return the causes that may be at work in a drive, those at a stop for each stop but the first."""
    at, P = Reference.of(fit.state), len(fit.problem.drive)
    return (
        *of_wheels(fit),
        FocusVaries(stops=P, at=at),
        *(CameraKnocked(stop=j) for j in range(1, P)),
        *(CameraKnocked(stop=j, shifted=False) for j in range(1, P)),
        *(CameraKnocked(stop=j, shifted=False, small=True) for j in range(1, P)),
        *(FocusChanged(stop=j, at=at) for j in range(1, P)),
        *(FocusChanged(stop=j, at=at, shifted=False) for j in range(1, P)),
    )
