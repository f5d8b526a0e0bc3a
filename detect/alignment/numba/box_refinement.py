"""The steps to a rigid box, corner after corner, without a matrix of all.

The reference is :func:`boxcal.detect.alignment.box_refinement.levenberg_marquardt`.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.box_refinement import (
    CAMERA,
    FITTED,
    ITERATIONS,
    LEAST_DEPTH,
    MORE_ITERATIONS,
    RANGE,
    State,
)
from boxcal.detect.alignment.numba.arrays import clear, clear_rows, put, put_rows
from boxcal.detect.alignment.numba.box_jacobian import (
    POINTS,
    ROWS,
    WIDE,
    add_products,
    deviations,
    differentiate,
    scalars,
    spreads,
    weigh,
)
from boxcal.detect.alignment.numba.cholesky import factor, solve_positive
from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.numba.radial_camera import square, to_pixel
from boxcal.detect.alignment.radial_camera import (
    A1,
    A2,
    A3,
    CENTRE_X,
    CENTRE_Y,
    LOG_ASPECT,
    P1,
    P2,
    PER_RADIUS,
    SKEW,
)
from boxcal.target.arrays import Array

_CAMERA, _UNKNOWNS = CAMERA, CAMERA + 6
_LONGEST = np.array([0.4, *[1e3] * (CAMERA - 1), 0.5, 0.5, 0.5, 1e3, 1e3, 1e3])
_FACTORS = 8
"""Number of factors whose logarithms are taken as that of their product."""
_FITTED = np.array(FITTED)
_NOTHING = np.empty((0, 0))


def levenberg_marquardt(  # noqa: PLR0917 - as the reference
    p_box: Array, uv: Array, start: State, prior: Array, expected: Array, sigma_px: float, fair: float
) -> tuple[float, Array, Array, Array, Array]:
    """Return what :func:`boxcal.detect.alignment.box_refinement.levenberg_marquardt` does."""
    lens, T = start[1].copy(), start[2].copy()
    information, off = np.empty((_UNKNOWNS, _UNKNOWNS)), np.empty(len(uv))
    points, knowledge = (p_box, uv, float(sigma_px), float(fair)), (prior, expected)
    focal = _refine(points, knowledge, float(start[0]), lens, T, information, off)
    return focal, lens, T, information, off


def predict(
    p_box: Array, focal: float, lens: Array, T_cam_box: Array, information: Array | None
) -> tuple[Array, Array]:
    """Return what :func:`boxcal.detect.alignment.box_refinement.predict` does."""
    uv, spread = np.empty((len(p_box), 2)), np.empty(0 if information is None else len(p_box))
    told = _NOTHING if information is None else information
    _predict(np.ascontiguousarray(p_box), float(focal), lens, T_cam_box, told, uv, spread)
    return uv, spread


@kernel()
def _refine(  # noqa: PLR0912, PLR0917 - arrays in, arrays out
    points: Any, knowledge: Any, focal: Any, lens: Any, T: Any, information: Any, off: Any
) -> Any:
    """Fit lens (6,), T_cam_box (4, 4), information (16, 16) and deviations (P,) in place; return the focal length."""
    p_box, uv, sigma_px, fair = points
    prior, expected = knowledge
    _bring_forward(focal, lens, T, p_box, uv)
    moved = (focal, lens.copy(), T.copy())
    now_off = np.empty(len(uv))
    gradient, step = np.zeros(_UNKNOWNS), np.zeros(_UNKNOWNS)
    camera, A, flat = np.empty(_CAMERA), np.empty((_UNKNOWNS, _UNKNOWNS)), np.zeros(ROWS * WIDE)
    clear_rows(information)
    for i in range(_UNKNOWNS):
        information[i, i] = 1.0
    clear(off)
    damping, cost = 1e-4, np.inf
    for iteration in range(MORE_ITERATIONS):
        if iteration >= ITERATIONS and np.median(off) < fair:
            break
        now_focal, now_lens, now_T = moved
        before = deviations(p_box, uv, scalars(now_focal, now_lens), now_T, now_off)
        scale = 3 * max(sigma_px, 1.2 * np.median(now_off))
        camera[0] = np.log(now_focal)
        for i in range(1, _CAMERA):
            camera[i] = now_lens[_FITTED[i - 1]]
        now = 0.0
        for first in range(0, len(uv), _FACTORS):
            product = 1.0
            for k in range(first, min(first + _FACTORS, len(uv))):
                product *= 1 + (now_off[k] / scale) ** 2
            now += scale**2 * np.log(product)
        for i in range(_CAMERA):
            now += prior[i] * (camera[i] - expected[i]) ** 2
        if not now <= cost * (1 + 1e-9) + 1e-12 or not before:
            damping *= 10
            if damping > 1e6:
                break
        else:
            done = cost - now < 1e-3 * now + 1e-9
            focal, cost = now_focal, now
            put(lens, now_lens)
            put_rows(T, now_T)
            put(off, now_off)
            _equations(p_box, uv, scalars(focal, lens), T, now_off, scale, flat, information, gradient)
            for i in range(_CAMERA):
                information[i, i] += prior[i]
                gradient[i] -= prior[i] * (camera[i] - expected[i])
            damping = max(damping * 0.2, 1e-9)
            if done:
                break
        put_rows(A, information)
        for i in range(_UNKNOWNS):
            A[i, i] += damping * (information[i, i] + 1e-9)
        solve_positive(A, gradient, step)
        for i in range(_UNKNOWNS):
            step[i] = min(max(step[i], -_LONGEST[i]), _LONGEST[i]) if np.isfinite(step[i]) else 0.0
        moved = _moved(focal, lens, T, step)
    return focal


@kernel(inner=True)
def _bring_forward(focal: Any, lens: Any, T: Any, p_box: Any, uv: Any) -> None:
    """Move a box until all its points lie before the camera, as ``box_refinement.bring_forward`` does."""
    away_x, away_y, away_z, per_px2 = 0.0, 0.0, 0.0, lens[PER_RADIUS] * lens[PER_RADIUS]
    for k in range(len(uv)):
        dx, dy = uv[k, 0] - lens[CENTRE_X], uv[k, 1] - lens[CENTRE_Y]
        q = (dx * dx + dy * dy) * per_px2
        z = focal * (1 - q * (lens[A1] + q * (lens[A2] + q * lens[A3])))
        length = np.sqrt(dx * dx + dy * dy + z * z)
        away_x, away_y, away_z = away_x + dx / length, away_y + dy / length, away_z + z / length
    away_x, away_y, away_z = away_x / len(uv), away_y / len(uv), away_z / len(uv)
    way = 0.0
    for k in range(len(uv)):
        _, D, ax, ay, _ = _tangent(focal, lens, uv[k, 0] - lens[CENTRE_X], uv[k, 1] - lens[CENTRE_Y])
        ax, ay, az = focal * ax, focal * ay, 1 / D
        x, y, z = _point(T, p_box[k])
        short = LEAST_DEPTH - (ax * x + ay * y + az * z)
        way = max(way, short / max(ax * away_x + ay * away_y + az * away_z, 1e-3))
    T[0, 3] += way * away_x
    T[1, 3] += way * away_y
    T[2, 3] += way * away_z


@kernel(inner=True)
def _moved(focal: Any, lens: Any, T: Any, step: Any) -> Any:
    """Return the state after a step: the pose turned and moved from the left."""
    lens, new = lens.copy(), T.copy()
    for i in range(1, _CAMERA):
        at = _FITTED[i - 1]
        lens[at] += step[i]
        if i > 2:
            high = RANGE[1] if i < 6 else -RANGE[0]
            lens[at] = min(max(lens[at], RANGE[0]), high)
    x, y, z = step[_CAMERA], step[_CAMERA + 1], step[_CAMERA + 2]
    angle = np.sqrt(x * x + y * y + z * z)
    a = np.sin(angle) / angle if angle > 1e-8 else 1.0
    b = (1 - np.cos(angle)) / angle**2 if angle > 1e-8 else 0.5
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    R[1, 0], R[1, 1], R[1, 2] = b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x
    R[2, 0], R[2, 1], R[2, 2] = b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)
    for i in range(3):
        for j in range(4):
            new[i, j] = R[i, 0] * T[0, j] + R[i, 1] * T[1, j] + R[i, 2] * T[2, j]
        new[i, 3] += step[_CAMERA + 3 + i]
    return focal * np.exp(step[0]), lens, new


@kernel(inner=True)
def _tangent(focal: Any, lens: Any, dx: Any, dy: Any) -> Any:
    """Return q, D and the row (3,) that gives a point's depth on the chart about the pixel at (dx, dy)."""
    a1, a2, a3, per_px2 = lens[A1], lens[A2], lens[A3], lens[PER_RADIUS] * lens[PER_RADIUS]
    q = (dx * dx + dy * dy) * per_px2
    slope = -2 * per_px2 * (a1 + q * (2 * a2 + q * (3 * a3)))
    D = 1 + q * (a1 + q * (3 * a2 + q * (5 * a3)))
    return q, D, -slope / D * dx, -slope / D * dy, 1 / (focal * D)


@kernel(inner=True)
def _distorted(lens: Any, u: Any, v: Any) -> Any:
    """Return a pixel with the tangential terms added, as ``radial_camera.distorted`` does."""
    x, y = square(lens, u - lens[CENTRE_X], v - lens[CENTRE_Y])
    p1, p2 = lens[PER_RADIUS] * lens[P1], lens[PER_RADIUS] * lens[P2]
    at_x, at_y = x, y
    for _ in range(2):
        both, xx, yy = 2 * at_x * at_y, at_x * at_x, at_y * at_y
        at_x, at_y = x - p1 * both - p2 * (3 * xx + yy), y - p1 * (xx + 3 * yy) - p2 * both
    at_y = np.exp(-lens[LOG_ASPECT]) * at_y
    return lens[CENTRE_X] + at_x + lens[SKEW] * at_y, lens[CENTRE_Y] + at_y


@kernel(inner=True)
def _point(T: Any, p: Any) -> Any:
    """Return the point p (3,) in the camera's frame."""
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3],
    )


@kernel()
def _predict(  # noqa: PLR0917
    p_box: Any, focal: Any, lens: Any, T: Any, information: Any, uv: Any, spread: Any
) -> None:
    """Fill where points (P, 3) are seen, (P, 2) px, NaN where out of view, and the deviations (P,), else infinite.

    The latter only if the array has space for them.
    """
    L, asked = information.copy(), len(spread) > 0
    for k in range(len(p_box)):
        x, y, z = _point(T, p_box[k])
        uv[k, 0], uv[k, 1] = to_pixel(lens, x, y, z / focal)
        if np.isfinite(uv[k, 0]):
            uv[k, 0], uv[k, 1] = _distorted(lens, uv[k, 0], uv[k, 1])
        else:
            uv[k, 0], uv[k, 1] = np.nan, np.nan
    if not asked:
        return
    factor(L)
    flat, some, camera = np.zeros(ROWS * WIDE), np.empty(POINTS), scalars(focal, lens)
    rows = flat.reshape((ROWS, WIDE))
    for first in range(0, len(p_box), POINTS):
        differentiate(p_box, uv, first, camera, T, flat)
        spreads(L, rows, some)
        for k in range(first, min(first + POINTS, len(p_box))):
            spread[k] = some[k - first] if np.isfinite(uv[k, 0]) else np.inf


@kernel(inner=True)
def _equations(  # noqa: PLR0917
    p_box: Any, uv: Any, camera: Any, T: Any, off: Any, scale: Any, flat: Any, normal: Any, gradient: Any
) -> None:
    """Fill the normal equations of the corners, each weighted by its deviation."""
    rows = flat.reshape((ROWS, WIDE))
    clear_rows(normal)
    clear(gradient)
    for first in range(0, len(uv), POINTS):
        differentiate(p_box, uv, first, camera, T, flat)
        weigh(off, first, scale, rows)
        add_products(rows, normal, gradient)
    for i in range(_UNKNOWNS):
        for j in range(i):
            normal[j, i] = normal[i, j]
