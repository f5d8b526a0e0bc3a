"""Losses of recordings as findings: data that are not whole, sizes that no log gives."""

from collections.abc import Sequence

from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.losses import LossKind

_ADVICE = {
    LossKind.DAMAGED: "Record the drive again, on a disk with room, and stop the recorder before the robot is switched "
    "off.",
    LossKind.UNDECODED: "Check the driver that publishes them, the recorder and its disk, and record again.",
    LossKind.NO_NUMBERS: "Check the wheels' driver and its connection to the motors, and record again.",
    LossKind.SIZES_UNKNOWN: "Give the driver's own wheels with --nominal, or record what its encoders say.",
}


def loss_findings(drives: Sequence[Correspondences]) -> tuple[Finding, ...]:
    """Return what is said of the recordings' losses; of several drives each names its log."""
    return tuple(
        Finding(
            cause=str(loss.kind),
            text=f"{drive.source.log}: {loss.text}" if len(drives) > 1 else loss.text,
            advice=_ADVICE[loss.kind],
        )
        for drive in drives
        for loss in drive.source.losses
    )
