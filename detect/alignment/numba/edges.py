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
"""Scratch rows of an edge: Phi with its kurtosis, its slope, widening, tail, density, and that times the distance once
and twice."""
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
    """Fill differences of a tag's modules to the next along u, along v and along both, and the modules (4, S).

    Modules are in rows one after the other.
    """
    side = cells.shape[0]
    for j in range(side):
        for i in range(side):
            right, below, at = min(i + 1, side - 1), min(j + 1, side - 1), j * side + i
            here, along_u, along_v = cells[j, i], cells[j, right], cells[below, i]
            out[0, at], out[1, at], out[3, at] = along_u - here, along_v - here, here
            out[2, at] = cells[below, right] - along_u - along_v + here


@loops(fastmath=True, forceinline=True)
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


@loops(fastmath=True, forceinline=True)
def edge(place: Any, inverse: Any, first: Any, e: Any, k: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill what a module edge does to each pixel of a block, a row for each of the seven values."""
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


@loops(fastmath=True, forceinline=True)
def cross(weights: Any, along: Any, down: Any, rho: Any, first: Any, total: Any) -> None:  # noqa: PLR0917
    """Add to P and its derivatives what the modules about the crossing of an edge along u and one along v make.

    ``weights`` are a module's differences and itself, see :func:`module_differences`; ``first`` says of both edges
    whether they are the first in reach. The first module counts once, and each edge's own differences once.
    """
    first_u, first_v = first
    if first_u and first_v:
        for p in range(BLOCK):
            total[p], total[_1 + p], total[_2 + p] = weights[_3 + p], _F0, _F0
            total[_3 + p], total[_4 + p] = _F0, _F0
    once_u, once_v = _F1 if first_v else _F0, _F1 if first_u else _F0
    for p in range(BLOCK):
        r, both, own_u, own_v = rho[p], weights[_2 + p], once_u * weights[p], once_v * weights[_1 + p]
        e0, e1, e2, e3 = down[p], down[_1 + p], down[_2 + p], down[_3 + p]
        e4, e5, e6 = down[_4 + p], down[_5 + p], down[_6 + p]
        s0, s1, s2, s3 = along[p], along[_1 + p], along[_2 + p], along[_3 + p]
        s4, s5, s6 = along[_4 + p], along[_5 + p], along[_6 + p]
        u, v = own_u + both * e0, own_v + both * s0
        tilt = r * both
        total[p] += u * s0 + own_v * e0 + tilt * (e4 * s4 + _F05 * r * e5 * s5)
        total[_1 + p] += u * s1 - tilt * e4 * s5
        total[_2 + p] += v * e1 - tilt * e5 * s4
        total[_3 + p] += u * s2 + v * e2 + tilt * (e4 * s6 + e6 * s4)
        total[_4 + p] += u * s3 + v * e3


@loops(fastmath=True, forceinline=True)
def jacobian(light: Any, at: Any, geometry: Any, total: Any, response_slope: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill the rows of the Jacobian; ``response_slope`` is 0 behind the last pixel."""
    _, gain, slope_x, slope_y, kappa = light
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
