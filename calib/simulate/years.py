"""Simulated years of a fleet: sessions that scatter, wheels that wear, a camera that is knocked."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import radians

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.history.channels import YEAR_NS
from boxcal.calib.history.session import Session
from boxcal.target.arrays import Array

_BEGIN_NS = 1_735_689_600 * 10**9
_CLAIMED = np.array(
    [0.03, 0.03, 0.05, 0.05, 1e-4, *[2e-4] * 2, 3e-4, *np.radians([0.01, 0.02, 0.01]), 2e-4, 2e-4, 3e-4]
)
"""Standard deviations that a calibration claims, in the order of ``ORDER`` (of wheels: relative)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Years:
    """Simulated history of a fleet.

    Attributes
    ----------
    robots, months, sessions
        Robots; months that pass; drives of each robot within them.
    scatter
        Standard deviation between sessions beyond what calibrations claim, in their sigmas.
    alike
        Degrees of freedom of the robots' own scatters about that (infinite: all alike).
    worn
        Robots whose wheels wear.
    wear
        Relative change of both radii over the whole time.
    knocked
        Robots whose camera is knocked, each with the number of the first session after it.
    knock : rad
        By how much, about an axis at random.
    tyres
        Robots that get tyres of another size, with the number of the first session after it.
    tyre
        Relative change of their radii.
    """

    robots: int = 50
    months: float = 12.0
    sessions: int = 52
    scatter: float = 1.5
    alike: float = 20.0
    worn: Sequence[int] = ()
    wear: float = -0.002
    knocked: dict[int, int] = field(default_factory=dict)
    knock: float = radians(0.3)
    tyres: dict[int, int] = field(default_factory=dict)
    tyre: float = -0.002


def simulated_years(asked: Years, rng: np.random.Generator) -> list[Session]:
    """Return the sessions of a fleet in the order of time, as calibrations with honest sigmas would give them."""
    out: list[Session] = []
    span = asked.months / 12
    for i in range(asked.robots):
        own = asked.scatter * np.sqrt(rng.chisquare(asked.alike) / asked.alike if np.isfinite(asked.alike) else 1.0)
        axis = rng.normal(size=3)
        knock = asked.knock * axis / np.linalg.norm(axis)
        wheels = np.array([0.033, 0.033, 0.16]) * (1 + 0.01 * rng.normal(size=3))
        camera = np.array([600.0, 600.0, 320.0, 240.0, -0.05]) + rng.normal(size=5) * [10, 10, 5, 5, 0.01]
        T = rigid(exp_so3(rng.normal(size=3)), np.array([0.05, 0.0, 0.2]))
        begin = rng.uniform(0, span / asked.sessions)
        for k in range(asked.sessions):
            years = begin + span * k / asked.sessions
            claimed = _CLAIMED * np.exp(0.2 * rng.normal())
            error = rng.normal(size=14) * claimed * np.sqrt(1 + own**2)
            now = wheels * (1 + error[5:8])
            now[:2] *= 1 + (asked.wear * years / span if i in asked.worn else 0.0)
            now[:2] *= 1 + (asked.tyre if k >= asked.tyres.get(i, asked.sessions) else 0.0)
            turned = exp_so3(knock) if k >= asked.knocked.get(i, asked.sessions) else np.eye(3)
            out.append(
                Session(
                    robot=f"r{i:04d}",
                    key=f"{i}-{k}",
                    t_ns=_BEGIN_NS + int(years * YEAR_NS),
                    calibrated="2026-01-01T00:00:00+00:00",
                    camera=camera + error[:5],
                    wheels=now,
                    T_body_cam=rigid(T[:3, :3] @ turned @ exp_so3(error[8:11]), T[:3, 3] + error[11:]),
                    covariance=_covariance(claimed, wheels),
                    image_size=(640, 480),
                    verdict="good",
                )
            )
    return sorted(out, key=lambda s: s.t_ns)


def _covariance(claimed: Array, wheels: Array) -> Array:
    sigma = claimed.copy()
    sigma[[ORDER.index(n) for n in ("rR", "rL", "b")]] *= wheels
    return np.diag(sigma**2)
