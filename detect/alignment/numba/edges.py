"""Contributions of module edges to a block of pixels and to its Jacobian, in single precision.

No loop has a branch, so that the compiler turns each into vector instructions. Edges enter by partial summation,
``sum_k E_k (Phi_k - Phi_k+1) = E_0 + sum_e Phi_e (E_e+1 - E_e)``, which needs the differences of the modules along u,
along v and along both only.
"""

from typing import Any

import numpy as np

from boxcal.detect.alignment.numba.kernel import kernel
from boxcal.detect.alignment.numba.pixels import BLOCK

OF_EDGE = 6
"""Rows an edge takes: Phi with its kurtosis, its slope, widening, tail, density, distance."""
_REACH = np.float32(4.5)
_F0, _F05, _F1, _F2, _F3, _F6 = (np.float32(x) for x in (0, 0.5, 1, 2, 3, 6))
_F24TH, _ROOT = np.float32(1 / 24), np.float32(1 / np.sqrt(2 * np.pi))
# Abramowitz and Stegun 26.2.17, |error| < 7.5e-8
_P = np.float32(0.2316419)
_B1, _B2, _B3, _B4, _B5 = (np.float32(x) for x in (0.319381530, -0.356563782, 1.781477937, -1.821255978, 1.330274429))
_32ND = np.float32(-1 / 32)
_E2, _E3, _E4, _E5, _E6 = (np.float32(x) for x in (1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720))


@kernel(inner=True, fastmath=True)
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


@kernel(inner=True, fastmath=True)
def blur_geometry(theta: Any, sigma: Any, blur: Any, at: Any, geometry: Any) -> None:
    """Fill 1 / w, 1 / s_u, 1 / s_v and the correlation of the blur on the tag."""
    h0, h1, h3, h4 = np.float32(theta[0]), np.float32(theta[1]), np.float32(theta[3]), np.float32(theta[4])
    h6, h7, inverse = np.float32(theta[6]), np.float32(theta[7]), np.float32(1 / sigma)
    limit = np.float32(0.9)
    # gradients turned by L^T, see psf.py
    xx, xy, yy = np.float32(blur[0]), np.float32(blur[1]), np.float32(blur[2])
    g0, g1, g3, g4, g6, g7 = xx * h0 + xy * h1, yy * h1, xx * h3 + xy * h4, yy * h4, xx * h6 + xy * h7, yy * h7
    for p in range(BLOCK):
        w = _F1 / (h6 * at[0, p] + h7 * at[1, p] + _F1)
        ux, uy = (g0 - at[2, p] * g6) * w, (g1 - at[2, p] * g7) * w
        vx, vy = (g3 - at[3, p] * g6) * w, (g4 - at[3, p] * g7) * w
        u, v = _F1 / np.sqrt(ux * ux + uy * uy), _F1 / np.sqrt(vx * vx + vy * vy)
        geometry[0, p] = w
        geometry[1, p] = u * inverse
        geometry[2, p] = v * inverse
        geometry[3, p] = min(max((ux * vx + uy * vy) * u * v, -limit), limit)


@kernel(inner=True, fastmath=True)
def edge(place: Any, inverse: Any, first: Any, e: Any, k: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill what a module edge does to each pixel of a block, a row for each of the six figures."""
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
        out[0, p] = step + np.float32(k) * tail
        out[1, p] = full
        out[2, p] = -a * full
        out[3, p] = tail
        out[4, p] = density
        out[5, p] = a


@kernel(inner=True, fastmath=True)
def across(weight: Any, edge: Any, sums: Any) -> None:
    """Add an edge along u, times the difference of the modules there, to the sums along a row of modules."""
    for p in range(BLOCK):
        c = weight[p]
        d = c * edge[4, p]
        da = d * edge[5, p]
        sums[0, p] += c * edge[0, p]
        sums[1, p] += c * edge[1, p]
        sums[2, p] += c * edge[2, p]
        sums[3, p] += c * edge[3, p]
        sums[4, p] += d
        sums[5, p] += da
        sums[6, p] += da * edge[5, p]


@kernel(inner=True, fastmath=True)
def down(sums: Any, edge: Any, rho: Any, total: Any) -> None:
    """Add an edge along v, times the sums along u of the differences there, to P and its derivatives."""
    for p in range(BLOCK):
        s, b = sums[0, p], edge[5, p]
        d = rho[p] * edge[4, p]
        db = d * b
        total[0, p] += edge[0, p] * s + d * sums[4, p] + _F05 * rho[p] * db * sums[5, p]
        total[1, p] += edge[0, p] * sums[1, p] - d * sums[5, p]
        total[2, p] += edge[1, p] * s - db * sums[4, p]
        total[3, p] += edge[0, p] * sums[2, p] + edge[2, p] * s + d * sums[6, p] + db * b * sums[4, p]
        total[4, p] += edge[0, p] * sums[3, p] + edge[3, p] * s


@kernel(inner=True, fastmath=True)
def jacobian(light: Any, at: Any, geometry: Any, total: Any, response_slope: Any, out: Any) -> None:  # noqa: PLR0917
    """Fill the rows of the Jacobian; ``response_slope`` is 0 behind the last pixel."""
    gain, slope_x, slope_y, kappa = (
        np.float32(light[1]), np.float32(light[2]), np.float32(light[3]), np.float32(light[4])
    )  # fmt: skip
    # short loops: of one with all of these rows the compiler does not see that they lie apart
    for p in range(BLOCK):
        factor = (gain + slope_x * at[0, p] + slope_y * at[1, p]) * response_slope[p]
        out[12, p] = factor * total[3, p]
        out[13, p] = factor * total[4, p]
        out[2, p] = factor * total[1, p] * geometry[1, p] * geometry[0, p]
        out[5, p] = factor * total[2, p] * geometry[2, p] * geometry[0, p]
    for k in (0, 3):
        for p in range(BLOCK):
            out[k, p] = out[k + 2, p] * at[0, p]
            out[k + 1, p] = out[k + 2, p] * at[1, p]
    for p in range(BLOCK):
        both = -(out[2, p] * at[2, p] + out[5, p] * at[3, p])
        out[6, p] = both * at[0, p]
        out[7, p] = both * at[1, p]
    for p in range(BLOCK):
        lit = (total[0, p] + kappa) * response_slope[p]
        out[8, p] = response_slope[p]
        out[9, p] = total[0, p] * response_slope[p]
        out[10, p] = at[0, p] * lit
        out[11, p] = at[1, p] * lit
