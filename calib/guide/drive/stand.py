"""The robot's current standstill and its duration, found in the wheel samples by what reads finished recordings."""

from dataclasses import dataclass

from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.stops import Stop, find_stops

_LEFT_NS = 150_000_000
"""A stand that ended so long before the newest sample is over."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stands:
    """Stands of the drive so far.

    Attributes
    ----------
    stops
        All of them; the last may go on.
    standing
        Whether it does.
    now_ns : ns
        Stamp of the newest sample.
    """

    stops: tuple[Stop, ...]
    standing: bool
    now_ns: int

    @property
    def seconds(self) -> float:
        """Time for which the robot has stood now, s; 0 if it moves."""
        return (self.stops[-1].t_end_ns - self.stops[-1].t_start_ns) / 1e9 if self.standing else 0.0


def stands_of(wheels: WheelSamples) -> Stands:
    """Return the stands in the samples so far."""
    stops = find_stops(wheels)
    now = int(wheels.t_ns[-1]) if len(wheels) else 0
    return Stands(stops=stops, standing=bool(stops) and now - stops[-1].t_end_ns < _LEFT_NS, now_ns=now)


def resting_all_along(first_ns: int, last_ns: int) -> Stands:
    """Return the one stand of wheels that have not moved since the beginning."""
    stop = Stop(t_start_ns=first_ns, t_end_ns=last_ns, first_sample=0, last_sample=0, phi_R=0.0, phi_L=0.0)
    return Stands(stops=(stop,), standing=True, now_ns=last_ns)
