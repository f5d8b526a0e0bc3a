"""Intensity of a tag's pattern under a Gaussian point spread function, with its derivatives.

A pixel at (x, y) lies at ``(u, v) = H(x, y)`` on the tag. Blur and pixel area together weigh the image plane with a
Gaussian of deviation sigma px, equal in all directions unless the image moved. On the tag that is a Gaussian of
deviations ``s_u = sigma |grad u|``, ``s_v = sigma |grad v|`` and correlation
``rho = grad u . grad v / (|grad u| |grad v|)``. Modules are rectangles, so the pattern under it is a sum over the
module edges i, j near the pixel,

    P(u, v) = sum_kl E_kl w_k(u) w_l(v) + rho sum_ij c_ij phi(a_i) phi(b_j) (1 + rho a_i b_j / 2),

with ``a_i = (u - i) / s_u``, ``w_k = Phi(a_k) - Phi(a_k+1)``, ``c_ij`` the second difference of the modules E at the
vertex: the tetrachoric series of the bivariate normal integral to second order (Pearson 1900,
DOI 10.1098/rsta.1900.0022).
A real blur is no Gaussian (a defocused lens spreads less far, a discrete filter further), so Phi carries the next
term of the Edgeworth series, ``Phi(a) - k (a^3 - 3 a) phi(a) / 24`` with the excess kurtosis k free.
"""

import numpy as np

from boxcal.detect.alignment.registration.parameters import KURTOSIS, LOG_PSF
from boxcal.target.arrays import Array


def pattern_value(  # noqa: PLR0917 - all that says what a pixel sees
    cells: Array, theta: Array, xy: Array, uv: Array, scale: float, blur: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return P at places of one tag and its derivatives by u, v, log sigma and kurtosis, each (P,).

    For ``blur`` (3,) see :class:`boxcal.detect.alignment.registration.tag_batch.Frame`.
    """
    from scipy.special import ndtr  # noqa: PLC0415 - .1 s to import, and compiled code does without

    modules = cells.shape[0] - 2
    sigma = np.exp(theta[LOG_PSF])
    w = 1 / (theta[6] * xy[:, 0] + theta[7] * xy[:, 1] + 1)
    u, v = uv[:, 0], uv[:, 1]
    ux, uy = (theta[0] - u * theta[6]) * w, (theta[1] - u * theta[7]) * w
    vx, vy = (theta[3] - v * theta[6]) * w, (theta[4] - v * theta[7]) * w
    # a PSF of covariance L L^T blurs as a round one does gradients turned by L^T
    (ux, uy), (vx, vy) = ((blur[0] * x + blur[1] * y, blur[2] * y) for x, y in ((ux, uy), (vx, vy)))
    s_u, s_v = np.hypot(ux, uy) * sigma * scale, np.hypot(vx, vy) * sigma * scale
    rho = np.clip((ux * vx + uy * vy) * (sigma * scale) ** 2 / (s_u * s_v), -0.9, 0.9)
    edges = np.arange(modules + 1)
    a, b = (u[:, None] - edges) / s_u[:, None], (v[:, None] - edges) / s_v[:, None]
    k = theta[KURTOSIS] / 24
    phi_a, phi_b = _density(a), _density(b)
    tail_a, tail_b = -(a * a - 3) * a * phi_a, -(b * b - 3) * b * phi_b
    big_a, big_b = ndtr(a) + k * tail_a, ndtr(b) + k * tail_b
    full_a = phi_a * (1 + k * (a * a * (a * a - 6) + 3))
    full_b = phi_b * (1 + k * (b * b * (b * b - 6) + 3))
    ones, zeros = np.ones((len(u), 1)), np.zeros((len(u), 1))
    weight_u = -np.diff(np.hstack([ones, big_a, zeros]), axis=1)
    weight_v = -np.diff(np.hstack([ones, big_b, zeros]), axis=1)
    slope_u = -np.diff(np.hstack([zeros, full_a, zeros]), axis=1)
    slope_v = -np.diff(np.hstack([zeros, full_b, zeros]), axis=1)
    wide_u = -np.diff(np.hstack([zeros, -a * full_a, zeros]), axis=1)
    wide_v = -np.diff(np.hstack([zeros, -b * full_b, zeros]), axis=1)
    more_u = -np.diff(np.hstack([zeros, tail_a, zeros]), axis=1) / 24
    more_v = -np.diff(np.hstack([zeros, tail_b, zeros]), axis=1) / 24
    vertex = cells[1:, 1:] - cells[1:, :-1] - cells[:-1, 1:] + cells[:-1, :-1]

    def both(left: Array, right: Array, kernel: Array) -> Array:
        return np.asarray(np.einsum("pj,jk,pk->p", left, kernel, right))

    first = both(phi_b, phi_a, vertex)
    second = both(b * phi_b, a * phi_a, vertex)
    p = both(weight_v, weight_u, cells) + rho * first + 0.5 * rho**2 * second
    p_u = both(weight_v, slope_u, cells) - rho * both(phi_b, a * phi_a, vertex)
    p_v = both(slope_v, weight_u, cells) - rho * both(b * phi_b, phi_a, vertex)
    p_s = both(weight_v, wide_u, cells) + both(wide_v, weight_u, cells)
    p_s = p_s + rho * both(phi_b, (a * a) * phi_a, vertex) + rho * both((b * b) * phi_b, phi_a, vertex)
    p_k = both(weight_v, more_u, cells) + both(more_v, weight_u, cells)
    return p, p_u / s_u, p_v / s_v, p_s, p_k


def _density(a: Array) -> Array:
    return np.asarray(np.exp(-0.5 * a * a) / np.sqrt(2 * np.pi))
