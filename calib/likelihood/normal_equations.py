"""Normal equations with a border of shared unknowns and a chain of stops, and their solution.

Legs couple neighbouring stops only, so the stops' block is block-tridiagonal: eliminating them (Schur complement) costs
a few products of 5 x 5 matrices a stop. All arrays may carry the same leading axes: a batch of systems.
"""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.likelihood.problem import PER_STOP
from boxcal.target.arrays import Array

_NULL = 1e-13
"""Eigenvalues of the scaled information below this are zero: a direction that the data do not determine."""


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
    """

    A: Array
    B: Array
    D: Array
    E: Array
    a: Array
    c: Array

    def damped(self, lam: float) -> "Normal":
        """Return the equations with Marquardt's damping."""
        return Normal(
            A=self.A * (1 + lam * np.eye(self.A.shape[-1])),
            B=self.B,
            D=self.D * (1 + lam * np.eye(PER_STOP)),
            E=self.E,
            a=self.a,
            c=self.c,
        )


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

    def stop_blocks(self) -> tuple[Array, Array]:
        """Return the stops' covariances (..., P, 5, 5), and those of each stop with the next (the last zero)."""
        pivots, gains = self.pivots, self.gains
        P = pivots.shape[-3]
        own, cross = np.empty_like(pivots), np.zeros_like(pivots)
        own[..., P - 1, :, :] = pivots[..., P - 1, :, :]
        for i in range(P - 2, -1, -1):
            G = gains[..., i, :, :]
            cross[..., i, :, :] = -G @ own[..., i + 1, :, :]
            own[..., i, :, :] = pivots[..., i, :, :] - cross[..., i, :, :] @ np.swapaxes(G, -1, -2)
        YC = self.Y @ self.cov[..., None, :, :]
        own += YC @ np.swapaxes(self.Y, -1, -2)
        cross[..., :-1, :, :] += YC[..., :-1, :, :] @ np.swapaxes(self.Y[..., 1:, :, :], -1, -2)
        return own, cross


def solve(normal: Normal) -> Solution:
    """Return the solution of the normal equations, with what their covariances need."""
    n, P = normal.A.shape[-1], normal.D.shape[-3]
    right = np.concatenate([np.swapaxes(normal.B, -1, -2), normal.c[..., None]], axis=-1)  # (..., P, 5, n + 1)
    pivots, gains = np.empty_like(normal.D), np.zeros_like(normal.D)
    D = normal.D[..., 0, :, :]
    for i in range(P):
        pivots[..., i, :, :] = inv = np.linalg.inv(D)
        if i + 1 < P:
            E = normal.E[..., i, :, :]
            gains[..., i, :, :] = G = inv @ E
            Gt = np.swapaxes(G, -1, -2)
            D = normal.D[..., i + 1, :, :] - Gt @ E
            right[..., i + 1, :, :] -= Gt @ right[..., i, :, :]
    back = pivots @ right
    reduced = np.sum(np.swapaxes(right[..., :n], -1, -2) @ back, axis=-3)
    S = normal.A - reduced[..., :n]
    s = normal.a - reduced[..., n]
    stops_decrease = np.einsum("...pk,...pk->...", right[..., n], back[..., n])
    for i in range(P - 2, -1, -1):
        back[..., i, :, :] -= gains[..., i, :, :] @ back[..., i + 1, :, :]
    cov, log_det = _invert(S)
    d_shared = np.einsum("...ij,...j->...i", cov, s)
    return Solution(
        d_shared=d_shared,
        d_stops=back[..., n] - np.einsum("...pij,...j->...pi", back[..., :n], d_shared),
        decrease=stops_decrease + np.einsum("...i,...i->...", s, d_shared),
        log_det=log_det - np.sum(np.linalg.slogdet(pivots)[1], axis=-1),
        information=S,
        cov=cov,
        Y=back[..., :n],
        pivots=pivots,
        gains=gains,
    )


def _invert(S: Array) -> tuple[Array, Array]:
    """Return the inverse of information matrices and their log determinants; null directions are left out."""
    diagonal = np.einsum("...ii->...i", S)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(S * scale[..., :, None] * scale[..., None, :])
    known = values > _NULL
    inverse = np.where(known, 1 / np.where(known, values, 1.0), 0.0)
    scaled = vectors * scale[..., :, None]
    log_det = np.sum(np.where(known, np.log(np.where(known, values, 1.0)), 0.0), axis=-1)
    return (scaled * inverse[..., None, :]) @ np.swapaxes(scaled, -1, -2), log_det - 2 * np.sum(np.log(scale), axis=-1)
