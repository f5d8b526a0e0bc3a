"""Contributions of module edges to a block of pixels and to its Jacobian, in single precision.

No loop has a branch, so that the compiler turns each into vector instructions. Rows of a block that belong together lie
one after the other in an array of one axis: so the compiler knows how far apart they are, and has but few arrays to
compare. Edges enter by partial summation,
``sum_k E_k (Phi_k - Phi_k+1) = E_0 + sum_e Phi_e (E_e+1 - E_e)``, which needs the differences of the modules along u,
along v and along both only.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import loops
from boxcal.detect.alignment.numba.pixels import BLOCK

OF_EDGE = 7 * BLOCK
"""Room of an edge: Phi with its kurtosis, its slope, widening, tail, density, and that times the distance once and
twice."""
_1, _2, _3, _4, _5, _6 = (k * BLOCK for k in range(1, 7))
"""Where rows begin after the first."""
_REACH = np.float32(4.5)
_F0, _F05, _F1, _F2, _F3, _F6 = (np.float32(x) for x in (0, 0.5, 1, 2, 3, 6))
_F24TH, _ROOT = np.float32(1 / 24), np.float32(1 / np.sqrt(2 * np.pi))
# Abramowitz and Stegun 26.2.17, |error| < 7.5e-8
_P = np.float32(0.2316419)
_B1, _B2, _B3, _B4, _B5 = (np.float32(x) for x in (0.319381530, -0.356563782, 1.781477937, -1.821255978, 1.330274429))
_32ND = np.float32(-1 / 32)
_E2, _E3, _E4, _E5, _E6 = (np.float32(x) for x in (1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720))


@loops(fastmath=True)
def module_differences(cells: Any, out: Any) -> None:
    """Fill a tag's modules (row 0, rows of modules one after the other) and their differences along u, v and both."""
    side = cells.shape[0]
    for j in range(side):
        for i in range(side):
            out[0, j * side + i] = cells[j, i]
    for k in range(side * side - 1):
        out[1, k] = out[0, k + 1] - out[0, k]
    for k in range(side * side - side):
        out[2, k] = out[0, k + side] - out[0, k]
        out[3, k] = out[1, k + side] - out[1, k]


@loops(fastmath=True)
def blur_geometry(theta: Any, sigma: Any, blur: Any, at: Any, geometry: Any) -> None:
    """Fill 1 / w, 1 / s_u, 1 / s_v and the correlation of the blur on the tag."""
    h0, h1, h3, h4 = np.float32(theta[0]), np.float32(theta[1]), np.float32(theta[3]), np.float32(theta[4])
    h6, h7, inverse = np.float32(theta[6]), np.float32(theta[7]), np.float32(1 / sigma)
    limit = np.float32(0.9)
    # gradients turned by L^T, see psf.py
    xx, xy, yy = np.float32(blur[0]), np.float32(blur[1]), np.float32(blur[2])
    g0, g1, g3, g4, g6, g7 = xx * h0 + xy * h1, yy * h1, xx * h3 + xy * h4, yy * h4, xx * h6 + xy * h7, yy * h7
    for p in range(BLOCK):
        place_u, place_v = at[_2 + p], at[_3 + p]
        w = _F1 / (h6 * at[p] + h7 * at[_1 + p] + _F1)
        ux, uy = (g0 - place_u * g6) * w, (g1 - place_u * g7) * w
        vx, vy = (g3 - place_v * g6) * w, (g4 - place_v * g7) * w
        u, v = _F1 / np.sqrt(ux * ux + uy * uy), _F1 / np.sqrt(vx * vx + vy * vy)
        geometry[p] = w
        geometry[_1 + p] = u * inverse
        geometry[_2 + p] = v * inverse
        geometry[_3 + p] = min(max((ux * vx + uy * vy) * u * v, -limit), limit)


@loops(fastmath=True)
def edge(place: Any, inverse: Any, first: Any, e: Any, k: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill what a module edge does to each pixel of a block, a row for each of the seven figures."""
    shift, k24 = np.float32(e), np.float32(k) * _F24TH
    for p in range(BLOCK):
        a = min(max((place[p] - (first[p] + shift)) * inverse[p], -_REACH), _REACH)
        a2 = a * a
        x = a2 * _32ND
        g = _F1 + x * (_F1 + x * (_E2 + x * (_E3 + x * (_E4 + x * (_E5 + x * _E6)))))
        g = g * g
        g = g * g
        g = g * g
        density = g * g * _ROOT
        t = _F1 / (_F1 + _P * abs(a))
        far = density * t * (_B1 + t * (_B2 + t * (_B3 + t * (_B4 + t * _B5))))
        step = _F1 - far if a > _F0 else far
        tail = -(a2 - _F3) * a * density * _F24TH
        full = density * (_F1 + k24 * (a2 * (a2 - _F6) + _F3))
        out[p] = step + np.float32(k) * tail
        out[_1 + p] = full
        out[_2 + p] = -a * full
        out[_3 + p] = tail
        out[_4 + p] = density
        out[_5 + p] = a * density
        out[_6 + p] = a2 * density


@loops(fastmath=True)
def across(weight: Any, edge: Any, sums: Any) -> None:
    """Add an edge along u, times the difference of the modules there, to the sums along a row of modules."""
    for p in range(BLOCK):
        c = weight[p]
        sums[p] += c * edge[p]
        sums[_1 + p] += c * edge[_1 + p]
        sums[_2 + p] += c * edge[_2 + p]
        sums[_3 + p] += c * edge[_3 + p]
        sums[_4 + p] += c * edge[_4 + p]
        sums[_5 + p] += c * edge[_5 + p]
        sums[_6 + p] += c * edge[_6 + p]


@loops(fastmath=True)
def down(sums: Any, edge: Any, rho: Any, total: Any) -> None:
    """Add an edge along v, times the sums along u of the differences there, to P and its derivatives."""
    for p in range(BLOCK):
        s0, s1, s2, s3 = sums[p], sums[_1 + p], sums[_2 + p], sums[_3 + p]
        s4, s5, s6 = sums[_4 + p], sums[_5 + p], sums[_6 + p]
        e0, e1, e2, e3 = edge[p], edge[_1 + p], edge[_2 + p], edge[_3 + p]
        e4, e5, e6 = edge[_4 + p], edge[_5 + p], edge[_6 + p]
        r = rho[p]
        total[p] += e0 * s0 + r * (e4 * s4 + _F05 * r * e5 * s5)
        total[_1 + p] += e0 * s1 - r * e4 * s5
        total[_2 + p] += e1 * s0 - r * e5 * s4
        total[_3 + p] += e0 * s2 + e2 * s0 + r * (e4 * s6 + e6 * s4)
        total[_4 + p] += e0 * s3 + e3 * s0


@loops(fastmath=True)
def jacobian(light: Any, at: Any, geometry: Any, total: Any, response_slope: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill the rows of the Jacobian; ``response_slope`` is 0 behind the last pixel."""
    gain, slope_x, slope_y, kappa = (
        np.float32(light[1]), np.float32(light[2]), np.float32(light[3]), np.float32(light[4])
    )  # fmt: skip
    for p in range(BLOCK):
        x, y, live, value = at[p], at[_1 + p], response_slope[p], total[p]
        factor, per_w = (gain + slope_x * x + slope_y * y) * live, geometry[p]
        by_u = factor * total[_1 + p] * geometry[_1 + p] * per_w
        by_v = factor * total[_2 + p] * geometry[_2 + p] * per_w
        both, lit = -(by_u * at[_2 + p] + by_v * at[_3 + p]), (value + kappa) * live
        out[p] = by_u * x
        out[_1 + p] = by_u * y
        out[_2 + p] = by_u
        out[_3 + p] = by_v * x
        out[_4 + p] = by_v * y
        out[_5 + p] = by_v
        out[_6 + p] = both * x
        out[7 * BLOCK + p] = both * y
        out[8 * BLOCK + p] = live
        out[9 * BLOCK + p] = value * live
        out[10 * BLOCK + p] = x * lit
        out[11 * BLOCK + p] = y * lit
        out[12 * BLOCK + p] = factor * total[_3 + p]
        out[13 * BLOCK + p] = factor * total[_4 + p]
