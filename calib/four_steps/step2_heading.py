"""Step 2: aR = rR / b and aL = -rL / b from turns and wheel angles (section 3.2, eqs. 15-23)."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import wrap
from boxcal.target.arrays import Array, Ids

MAX_CONDITION = 3000.0
"""Largest condition number of the regressor; beyond it the moves are proportional to each other for all purposes."""
USUAL_RMS = float(np.radians(0.2))
"""With turns as good as this, moves that still leave a large standard error are too much alike."""
MAX_RELATIVE_SIGMA = 0.1
"""Largest standard error of aR or aL, relative to its size."""
_SHORTEST = 10
_WINDINGS = np.array([(k, m) for k in (-1, 0, 1) for m in (-1, 0, 1)], dtype=np.float64)
_CANDIDATES = 8
_ALL_OF = 500
"""This many of the shortest moves, and as many of the others, judge the hypotheses."""
_EQUAL_FIT = 1.5
_ALIKE = 0.2
_TELLING = 3
"""Moves from which on residuals show how often the robot turned."""
_LARGEST = 1.0
"""Radius of a wheel over the wheel separation that no robot has."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadingStep:
    """Result of step 2: wheel radii over wheel separation.

    Attributes
    ----------
    aR, aL
        ``rR / b`` and ``-rL / b``: heading change per wheel angle.
    rms : rad
        Root mean square difference between turns seen and turns rolled, over all pairs.
    condition
        Condition number of the regressor.
    """

    aR: float
    aL: float
    rms: float
    condition: float


def solve_heading(turn: Array, phi: Array, moves: int) -> HeadingStep:
    """Return aR and aL by least squares over pairs of stops, ``dtheta = aR dphi_R + aL dphi_L`` (eqs. 17-23).

    The images give turns modulo 2 pi only. Windings are resolved without nominal values: see :func:`unwrap_turns`.

    Parameters
    ----------
    turn : (N,), rad
        Turns seen, ``theta_j - theta_i``, modulo a full turn.
    phi : (N, 2), rad
        Wheel angles travelled, right and left.
    moves
        How many of the pairs are independent (stops less one): what the standard error counts.

    Raises
    ------
    CalibError
        If there are fewer than three stops, if the moves are proportional to each other (rank 1), or if the signs of
        aR and aL say that wheels are swapped or reversed.
    """
    if moves < 2:
        raise CalibError(f"{moves + 1} usable stops, at least 3 are needed", remedy="add stops")
    turn = wrap(turn)
    singular = np.linalg.svd(np.linalg.qr(phi, mode="r"), compute_uv=False)
    condition = float(singular[0] / singular[1]) if singular[1] > 0 else np.inf
    if condition > MAX_CONDITION:
        raise CalibError(_proportional(phi, condition))
    dtheta = unwrap_turns(turn, phi)
    (aR, aL), *_ = np.linalg.lstsq(phi, dtheta, rcond=None)
    rms = float(np.sqrt(np.mean((dtheta - phi @ (aR, aL)) ** 2)))
    unit = np.sqrt(len(phi) / moves) * np.sqrt(np.diag(np.linalg.inv(phi.T @ phi)))
    limit = MAX_RELATIVE_SIGMA * max(abs(aR), abs(aL))
    if np.any(rms * unit > limit):
        if np.any(USUAL_RMS * unit > limit):
            raise CalibError(_proportional(phi, condition))
        raise CalibError(
            f"turns seen and turns rolled differ by {np.degrees(rms):.2g} deg (rms), too much to tell the wheels apart "
            f"with these moves (condition number {condition:.0f}): strong slip, or stamps of camera and wheels that do "
            "not fit together",
            remedy="drive slower, and add moves with more turning, left and right",
        )
    _check_signs(float(aR), float(aL), moves)
    return HeadingStep(aR=float(aR), aL=float(aL), rms=rms, condition=condition)


def unwrap_turns(turn: Array, phi: Array) -> Array:
    """Return turns with their full turns added, (N,), rad, so that some (aR, aL) explains all of them.

    Hypotheses come from couples among the pairs that moved least, each turn with -1, 0 or 1 full turns added. Every
    hypothesis is scored by the wrapped residuals of all pairs (of many pairs, of some of each length); the best few are
    then grown from short moves to long ones, unwrapping with what the shorter ones gave, and the one with the smallest
    residual is kept. Three stops leave the phase ambiguity open (any turns fit exactly): of those that fit equally
    well, with wheels alike and smaller than their separation, the one that turns least wins.

    Parameters
    ----------
    turn : (N,), rad
        In [-pi, pi).
    phi : (N, 2), rad
        Wheel angles travelled, right and left.
    """
    order = np.argsort(np.abs(phi).sum(axis=1), kind="stable")
    turn_by_size, phi_by_size = turn[order], phi[order]
    hypotheses = _hypotheses(turn_by_size[:_SHORTEST], phi_by_size[:_SHORTEST])
    # Short moves count most at first: a slightly wrong hypothesis wraps on long ones.
    ranks = _spread(len(turn))
    weight = np.diff(np.append(ranks, len(turn))) / (1 + ranks)
    turn_by_size, phi_by_size = turn_by_size[ranks], phi_by_size[ranks]
    # In single precision, which resolves a thousand radians to 1e-4 and takes a twentieth of the time.
    h, t, p, w = (part.astype(np.float32) for part in (hypotheses, turn_by_size, phi_by_size, weight))
    score = (1 - np.cos(t - h @ p.T)) @ w + 1e-4 * _unlikeness(hypotheses)
    a, grown = _grow(hypotheses[np.argsort(score, kind="stable")[:_CANDIDATES]], turn_by_size, phi_by_size)
    fit = _fitted(phi_by_size, grown)
    rms = np.sqrt(np.mean((grown - phi_by_size @ fit.T) ** 2, axis=0))
    huge = np.max(np.abs(fit), axis=1) > _LARGEST
    unlike, turned = _unlikeness(fit) > _ALIKE, np.sum(np.abs(grown), axis=0)
    equal = np.flatnonzero(rms <= _EQUAL_FIT * rms.min() + 1e-9)
    return _unwrapped(turn, phi @ a[min(equal, key=lambda k: (huge[k], unlike[k], turned[k]))])


def _spread(count: int) -> Ids:
    """Return the ranks that hypotheses are scored by: all of the first, then fewer and fewer, (M,), ascending."""
    few = np.arange(min(count, _ALL_OF))
    return few if count <= _ALL_OF else np.union1d(few, np.geomspace(1, count, _ALL_OF).astype(int) - 1)


def _unlikeness(a: Array) -> Array:
    """Return how unlike the two wheels of hypotheses (H, 2) are, (H,): log of their ratio, more if both turn alike."""
    size = np.maximum(np.abs(a), 1e-12)
    return np.asarray(np.abs(np.log(size[:, 0] / size[:, 1])) + (a[:, 0] * a[:, 1] > 0))


def _hypotheses(turn: Array, phi: Array) -> Array:
    """Return candidate (aR, aL), (H, 2), from couples of short moves that are not proportional."""
    k, m = np.triu_indices(len(turn), 1)
    A = phi[np.stack([k, m], axis=1)]  # (C, 2, 2)
    size = np.linalg.norm(A, axis=2).prod(axis=1)
    good = np.abs(np.linalg.det(A)) > size / MAX_CONDITION
    if not np.any(good):  # all short moves are alike: take the least squares direction of all of them
        fit, *_ = np.linalg.lstsq(phi, turn, rcond=None)
        return np.asarray(fit[None, :])
    turns = turn[np.stack([k, m], axis=1)][good][:, None, :] + 2 * np.pi * _WINDINGS  # (C, 9, 2)
    return np.asarray((turns @ np.swapaxes(np.linalg.inv(A[good]), 1, 2)).reshape(-1, 2))


def _grow(a: Array, turn: Array, phi: Array) -> tuple[Array, Array]:
    """Return C hypotheses (C, 2) after they grew, and turns unwrapped with them, (N, C); moves in order of size.

    Each batch of moves is unwrapped with the fit of all before it.
    """
    n = len(turn)
    size = min(n, 4)
    while True:
        a = _fitted(phi[:size], _unwrapped(turn[:size, None], phi[:size] @ a.T))
        if size == n:
            return a, _unwrapped(turn[:, None], phi @ a.T)
        size = min(n, size + max(1, size // 2))


def _unwrapped(turn: Array, expected: Array) -> Array:
    """Return turns with the full turns added that bring them nearest to what is expected, rad."""
    return np.asarray(expected + wrap(turn - expected))


def _fitted(phi: Array, turns: Array) -> Array:
    """Return aR and aL, (C, 2), that fit C sets of turns (N, C) of the same moves (N, 2) best."""
    (a, b), (_, d) = (phi.T @ phi).tolist()
    a, d = a + 1e-12 * (a + d), d + 1e-12 * (a + d)  # moves may all be alike
    determinant = a * d - b * b
    if not determinant > 0:
        raise np.linalg.LinAlgError("wheels that do not turn")
    return np.asarray((phi.T @ turns).T @ (np.array([[d, -b], [-b, a]]) / determinant))


def _proportional(phi: Array, condition: float) -> str:
    """Return why moves that are all proportional do not determine aR and aL, and what to add."""
    direction = np.linalg.svd(phi, full_matrices=False)[2][0]
    straight = direction / np.abs(direction).max()
    what = f"the moves are nearly proportional to each other (condition number {condition:.3g})"
    if straight[0] * straight[1] < 0:
        return (
            f"{what}: the robot only turned on the spot, so the wheels' radii cannot be told apart and their size "
            "is not determined; add legs that drive forward"
        )
    if abs(straight[0] - straight[1]) < 0.02:
        return (
            f"{what}: the robot only drove straight, so the wheelbase is not determined; add legs that turn, left and "
            "right"
        )
    return (
        f"{what}: all turns are alike (one curve over and over), so the wheels cannot be told apart; add legs of "
        "another curvature: straight ones, turns on the spot, the other direction"
    )


def _check_signs(aR: float, aL: float, moves: int) -> None:
    """Refuse wheels that roll in the wrong direction: aR > 0 > aL must come out."""
    if aR > 0 > aL:
        return
    found = f"aR = {aR:.4g} and aL = {aL:.4g} (aR > 0 > aL is needed)"
    if moves < _TELLING:
        raise CalibError(
            f"{moves + 1} stops do not determine how the wheels roll, any number of whole turns between them fits: "
            f"{found}",
            remedy="add stops, with less turning between them",
        )
    if aR < 0 < aL:
        raise CalibError(
            f"left and right wheel joints are swapped: {found}",
            remedy="exchange --left-joint and --right-joint (or, if both "
            "wheels count backwards, reverse the sign of both)",
        )
    wheel = "left" if aR > 0 else "right"
    raise CalibError(
        f"the sign of the {wheel} wheel is reversed: {found}",
        remedy=f"wheel angles must grow when the wheel rolls forward, reverse the {wheel} wheel's encoder",
    )
