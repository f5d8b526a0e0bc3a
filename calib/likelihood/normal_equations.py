"""Normal equations with a border of shared unknowns, a chain of stops and local unknowns, these eliminated first.

What belongs to one stop's image alone (its lean, say) is eliminated for all stops at once (Schur complement); the
chain of stops is the work of :mod:`boxcal.calib.likelihood.stop_elimination`. All arrays may carry the same leading
axes: a batch of systems.
"""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.likelihood.backend import backend
from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Local:
    """Blocks of the q local unknowns of every stop.

    Attributes
    ----------
    D : (P, q, q)
        Among themselves.
    by_shared, by_chain : (P, n, q), (P, 5, q)
        By the shared unknowns and by the stop's own in the chain.
    c : (P, q)
        Right-hand sides.
    """

    D: Array
    by_shared: Array
    by_chain: Array
    c: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eliminated:
    """Factors of the elimination, from which the local unknowns are recovered.

    Attributes
    ----------
    inverse : (P, q, q)
        Of their own block.
    by_shared, by_chain : (P, q, n), (P, q, 5)
        That inverse times the blocks by shared unknowns and chain: the local unknowns follow by less that.
    c : (P, q)
        Their values where nothing else moves.
    decrease, log_det
        Part in the sum of squares and in the logarithm of the determinant.
    """

    inverse: Array
    by_shared: Array
    by_chain: Array
    c: Array
    decrease: float
    log_det: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Normal:
    """Normal equations ``H d = g`` of n shared unknowns and P stops.

    Attributes
    ----------
    A : (..., n, n)
        Shared unknowns.
    B : (..., P, n, 5)
        Shared by stop.
    D : (..., P, 5, 5)
        Stops.
    E : (..., P, 5, 5)
        Stop by the next stop; the last is zero.
    a : (..., n)
        Right-hand side of the shared unknowns.
    c : (..., P, 5)
        Right-hand sides of the stops.
    local
        Local unknowns, where there are any.
    """

    A: Array
    B: Array
    D: Array
    E: Array
    a: Array
    c: Array
    local: Local | None = None

    def damped(self, lam: float) -> "Normal":
        """Return the equations with Marquardt's damping."""
        local = self.local
        if local is not None:
            local = replace(local, D=local.D * (1 + lam * np.eye(local.D.shape[-1])))
        return replace(
            self,
            A=self.A * (1 + lam * np.eye(self.A.shape[-1])),
            D=self.D * (1 + lam * np.eye(self.D.shape[-1])),
            local=local,
        )

    def plus(self, other: "Normal") -> "Normal":
        """Return the sum with equations that have no local unknowns; those may be a batch."""
        return Normal(
            A=self.A + other.A,
            B=self.B + other.B,
            D=self.D + other.D,
            E=self.E + other.E,
            a=self.a + other.a,
            c=self.c + other.c,
            local=self.local,
        )


def eliminate(normal: Normal) -> tuple[Normal, Eliminated]:
    """Return the equations without their local unknowns, and how to find those again."""
    local = normal.local
    if local is None:
        P, n, k = len(normal.D), normal.A.shape[-1], normal.D.shape[-1]
        nothing = np.zeros((P, 0, 0))
        return normal, Eliminated(
            inverse=nothing,
            by_shared=np.zeros((P, 0, n)),
            by_chain=np.zeros((P, 0, k)),
            c=np.zeros((P, 0)),
            decrease=0.0,
            log_det=0.0,
        )
    inverse, log_det = backend().inverses(local.D)
    by_shared = inverse @ np.swapaxes(local.by_shared, -1, -2)
    by_chain = inverse @ np.swapaxes(local.by_chain, -1, -2)
    c = (inverse @ local.c[..., None])[..., 0]
    n = normal.A.shape[-1]
    reduced = replace(
        normal,
        A=normal.A - np.swapaxes(local.by_shared, -1, -2).reshape(-1, n).T @ by_shared.reshape(-1, n),
        B=normal.B - local.by_shared @ by_chain,
        D=normal.D - local.by_chain @ by_chain,
        a=normal.a - np.einsum("pnq,pq->n", local.by_shared, c),
        c=normal.c - np.einsum("pkq,pq->pk", local.by_chain, c),
        local=None,
    )
    eliminated = Eliminated(
        inverse=inverse,
        by_shared=by_shared,
        by_chain=by_chain,
        c=c,
        decrease=float(np.sum(c * local.c)),
        log_det=float(np.sum(log_det)),
    )
    return reduced, eliminated
