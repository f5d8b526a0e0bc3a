"""Wheel samples: what the encoders of one robot read, and when."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.errors import DetectError

Array = NDArray[np.float64]
Ids = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelSamples:
    """Angles of the two wheels over time; positive angles roll the robot forward.

    Attributes
    ----------
    t_ns : (S,) int64, ns
        Header stamps, strictly ascending.
    phi_R, phi_L : (S,), rad
        Right and left wheel, unwrapped (not modulo a turn).
    """

    t_ns: Ids
    phi_R: Array
    phi_L: Array

    def __post_init__(self) -> None:
        if not (self.t_ns.ndim == 1 and self.t_ns.shape == self.phi_R.shape == self.phi_L.shape):
            raise DetectError(
                f"wheel samples: found shapes {self.t_ns.shape}, {self.phi_R.shape} and {self.phi_L.shape}; "
                "three vectors of one length are needed"
            )
        if self.t_ns.size > 1 and not np.all(np.diff(self.t_ns) > 0):
            raise DetectError("wheel samples: times do not ascend; sort the samples and drop repeated stamps")
        if not (np.all(np.isfinite(self.phi_R)) and np.all(np.isfinite(self.phi_L))):
            raise DetectError("wheel samples: an angle is not finite; drop such samples")

    def __len__(self) -> int:
        return int(self.t_ns.size)
