"""Solution of normal equations whose stops form a chain: these are eliminated one after the other.

Legs couple neighbouring stops only, so the stops' block is block-tridiagonal: eliminating them (Schur complement) costs
a few products of 5 x 5 matrices a stop. All arrays may carry the same leading axes: a batch of systems.
"""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.information_inverse import invert
from boxcal.calib.likelihood.normal_equations import Eliminated, Normal, eliminate
from boxcal.target.arrays import Array, Mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """Solution of :class:`Normal`.

    Attributes
    ----------
    d_shared : (..., n)
    d_stops : (..., P, 5)
    decrease
        ``g H^-1 g``: how much the step lowers the sum of squares, (...).
    log_det
        Of H, up to a constant where a direction is not determined, (...).
    information : (..., n, n)
        Of the shared unknowns, the stops eliminated.
    cov : (..., n, n)
        Its inverse (pseudo-inverse where directions are not determined).
    Y : (..., P, 5, n)
        Stops' part of ``H_ss^-1 H_sg``: the stops' change by the shared unknowns is ``-Y``.
    pivots, gains : (..., P, 5, 5)
        The chain's factors.
    eliminated
        Of the local unknowns.
    """

    d_shared: Array
    d_stops: Array
    decrease: Array
    log_det: Array
    information: Array
    cov: Array
    Y: Array
    pivots: Array
    gains: Array
    eliminated: Eliminated

    @property
    def d_local(self) -> Array:
        """Steps of the local unknowns, (..., P, q)."""
        return self.local_step(self.d_shared, self.d_stops)

    def local_step(self, d_shared: Array, d_stops: Array) -> Array:
        """Return the local unknowns' steps, (..., P, q), that go with steps of all others."""
        e = self.eliminated
        return np.asarray(
            e.c
            - np.einsum("pqn,...n->...pq", e.by_shared, d_shared)
            - np.einsum("pqk,...pk->...pq", e.by_chain, d_stops)
        )

    def stop_blocks(self) -> tuple[Array, Array]:
        """Return the stops' covariances (..., P, 5, 5), and those of each stop with the next (the last zero)."""
        own, cross = backend().chain_covariances(_as_batch(self.pivots, 3), _as_batch(self.gains, 3))
        own, cross = own.reshape(self.pivots.shape), cross.reshape(self.pivots.shape)
        YC = self.Y @ self.cov[..., None, :, :]
        own += YC @ np.swapaxes(self.Y, -1, -2)
        cross[..., :-1, :, :] += YC[..., :-1, :, :] @ np.swapaxes(self.Y[..., 1:, :, :], -1, -2)
        return own, cross

    def at(self, k: int) -> "Solution":
        """Return one solution of a batch."""
        return Solution(
            d_shared=self.d_shared[k],
            d_stops=self.d_stops[k],
            decrease=self.decrease[k],
            log_det=self.log_det[k],
            information=self.information[k],
            cov=self.cov[k],
            Y=self.Y[k],
            pivots=self.pivots[k],
            gains=self.gains[k],
            eliminated=self.eliminated,
        )

    def joint_covariances(self) -> Array:
        """Return the covariance of the shared unknowns and of each stop's own in the chain, (P, n + 5, n + 5)."""
        own, _ = self.stop_blocks()
        n, P = self.cov.shape[-1], len(own)
        out = np.empty((P, n + own.shape[-1], n + own.shape[-1]))
        out[:, :n, :n] = self.cov
        out[:, n:, :n] = -self.Y @ self.cov
        out[:, :n, n:] = np.swapaxes(out[:, n:, :n], 1, 2)
        out[:, n:, n:] = own
        return out

    def local_variances(self, joint: Array) -> Array:
        """Return the local unknowns' variances, (P, q), from the covariances of all others (P, n + 5, n + 5)."""
        e = self.eliminated
        K = np.concatenate([e.by_shared, e.by_chain], axis=2)
        return np.asarray(np.einsum("pqq->pq", e.inverse) + np.sum(K @ joint * K, axis=2))


def solve(normal: Normal) -> Solution:
    """Return the solution of the normal equations, with what their covariances need."""
    reduced, eliminated = eliminate(normal)
    return solve_chain(reduced, eliminated)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EliminatedChain:
    """Equations of the shared unknowns alone, and the factors of the chain that was eliminated.

    Attributes
    ----------
    information, right : (..., n, n), (..., n)
        Of the shared unknowns.
    back : (..., P, 5, n + 1)
        Stops' blocks by shared unknowns, and their right-hand sides, half solved for.
    pivots, gains : (..., P, 5, 5)
        The chain's factors.
    decrease, log_det : (...)
        The stops' part in the sum of squares and in the logarithm of the determinant.
    """

    information: Array
    right: Array
    back: Array
    pivots: Array
    gains: Array
    decrease: Array
    log_det: Array

    def some(self, kept: Mask) -> "EliminatedChain":
        """Return some of a batch, copied."""
        return EliminatedChain(
            information=self.information[kept],
            right=self.right[kept],
            back=self.back[kept],
            pivots=self.pivots[kept],
            gains=self.gains[kept],
            decrease=self.decrease[kept],
            log_det=self.log_det[kept],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bordered:
    """Equations as the elimination of the stops takes them: :class:`Normal` without local unknowns.

    Attributes
    ----------
    A, a, D, E
        As there, with or without the leading axes.
    right : (..., P, 5, n + 1)
        Stops by the shared unknowns, and right-hand sides of the stops; the elimination uses them up.
    """

    A: Array
    a: Array
    D: Array
    E: Array
    right: Array


def bordered(normal: Normal) -> Bordered:
    """Return equations as the elimination of the stops takes them."""
    n = normal.A.shape[-1]
    right = np.empty((*normal.c.shape, n + 1))
    right[..., :n], right[..., n] = np.swapaxes(normal.B, -1, -2), normal.c
    return Bordered(A=normal.A, a=normal.a, D=normal.D, E=normal.E, right=right)


def eliminate_chain(equations: Normal | Bordered) -> EliminatedChain:
    """Return the shared unknowns' equations of a system whose local unknowns are eliminated.

    Raises
    ------
    LinAlgError
        If nothing holds a stop.
    """
    e = bordered(equations) if isinstance(equations, Normal) else equations
    right, compute = e.right, backend()
    n, batch = right.shape[-1] - 1, right.shape[:-3]
    pivots, gains, back, log_det = (
        part.reshape((*batch, *part.shape[1:]))
        for part in compute.eliminate_stops(_as_batch(e.D, 3), _as_batch(e.E, 3), _as_batch(right, 3))
    )
    flat = right.reshape(*batch, -1, n + 1)
    reduced = np.swapaxes(flat, -1, -2) @ back.reshape(*batch, -1, n + 1)
    return EliminatedChain(
        information=e.A - reduced[..., :n, :n],
        right=e.a - reduced[..., :n, n],
        back=back,
        pivots=pivots,
        gains=gains,
        decrease=reduced[..., n, n],
        log_det=log_det,
    )


def solve_chain(normal: Normal | Bordered, eliminated: Eliminated) -> Solution:
    """Return the solution of equations whose local unknowns are eliminated; errors as of :func:`eliminate_chain`."""
    return solve_shared(eliminate_chain(normal), eliminated)


def solve_shared(chain: EliminatedChain, eliminated: Eliminated) -> Solution:
    """Return the solution of equations whose local unknowns and stops are eliminated; ``chain.back`` is used up."""
    n, back, s = chain.information.shape[-1], chain.back, chain.right
    backend().substitute_back(_as_batch(chain.gains, 3), _as_batch(back, 3))
    cov, log_det = invert(chain.information)
    d_shared = np.einsum("...ij,...j->...i", cov, s)
    return Solution(
        d_shared=d_shared,
        d_stops=back[..., n] - np.einsum("...pij,...j->...pi", back[..., :n], d_shared),
        decrease=chain.decrease + np.einsum("...i,...i->...", s, d_shared) + eliminated.decrease,
        log_det=log_det + chain.log_det + eliminated.log_det,
        information=chain.information,
        cov=cov,
        Y=back[..., :n],
        pivots=chain.pivots,
        gains=chain.gains,
        eliminated=eliminated,
    )


def _as_batch(part: Array, axes: int) -> Array:
    """Return an array with one leading axis before its last ones; changes in place reach a contiguous original."""
    return np.ascontiguousarray(part).reshape(-1, *part.shape[-axes:])
