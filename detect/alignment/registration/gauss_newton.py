"""The Gauss-Newton steps of an alignment, all tags at once; :mod:`boxcal.detect.alignment.numba` takes the same."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.registration import image_model as model
from boxcal.detect.alignment.registration.finish import kurtosis_prior
from boxcal.detect.alignment.registration.image_model import Sums
from boxcal.detect.alignment.registration.parameters import KURTOSIS, LOG_PSF, PARAMETERS
from boxcal.detect.alignment.registration.sandwich_sums import PartSums, sum_parts
from boxcal.detect.alignment.registration.tag_batch import Batch
from boxcal.detect.alignment.tag_patterns import Index
from boxcal.target.arrays import Array

LOG_SIGMA_RANGE = (float(np.log(0.27)), float(np.log(12.0)))
"""Of the PSF's deviation, log px: a pixel's own area has 0.29 px; wider than 12 px no tag is read."""
KURTOSIS_RANGE = (-1.3, 1.5)
"""A disc has -1, a square pixel -1.2; beyond these the Edgeworth series is no distribution."""
MUCH = 0.6
"""A step that explains this fraction of the squared residuals is not the last."""
THINNED, LEAST_THINNED = 4, 400
"""Of a thinned first step: one in this many pixels counts, of tags that have this many at least."""
LONGEST_MODULES, LONGEST_LOG, MOST_EXPLAINED = 0.8, 0.35, 0.98
"""Longest step of a point, modules, and of log sigma; largest fraction of the squared residuals it may explain."""


class StepRules(NamedTuple):
    """Settings of the Gauss-Newton steps.

    Attributes
    ----------
    free : (S, 14)
        What each step may change; the last row holds for all further steps.
    damping
        Of the normal matrix's diagonal (Levenberg-Marquardt), relative.
    stop_px
        A tag is done once a step moves its corners less and its residuals have settled.
    iterations
        Largest number of steps.
    guess
        Set black and white from the middle of the modules first.
    thinned
        Take the first step of large tags with few of their pixels: it need only lead near enough for the next, and is
        never the last.
    sums_only
        Fill the sums and take no step; of compiled code, where that saves a second copy of what fills them.
    """

    free: NDArray[np.bool_]
    damping: float
    stop_px: float
    iterations: int
    guess: bool
    thinned: bool = False
    sums_only: bool = False


def iterate(
    batch: Batch,
    sums: Sums,
    *,
    normalised: Array,
    module_px: Array,
    rules: StepRules,
    sums_of: Callable[[Batch], Sums] = model.accumulate,
    parts: PartSums | None = None,
) -> None:
    """Take Gauss-Newton steps until each tag stands still; parameters and ``sums`` (from zero) change in place.

    Parameters
    ----------
    batch
        The tags.
    sums
        Of the last step, the sum of squared residuals less what that step explains.
    normalised : (N, 4, 2)
        Corners in normalised places; what moves there says when to stop.
    module_px : (N,), px
        Width of a module.
    rules
        How steps are taken.
    sums_of
        Computes the normal equations.
    parts
        Filled with sums over parts of the tags that are asked.
    """
    theta = batch.theta
    if rules.guess:
        model.initial_intensity(batch)
    active = np.arange(len(batch))
    thinned = np.zeros(len(batch), dtype=np.bool_)
    for step_no in range(rules.iterations):
        if len(active) == 0:
            break
        now = sums_of(batch.take(active))
        if step_no == 0 and rules.thinned:
            thinned = now.stats[:, 0] >= LEAST_THINNED
            few = sums_of(replace(batch.take(np.flatnonzero(thinned)), every=THINNED))
            _put(now, np.flatnonzero(thinned), few)
        step = _step(now, theta[active], rules.free[min(step_no, len(rules.free) - 1)], rules.damping)
        stepped = _stepped(theta[active], step)
        less = _explained(now, stepped - theta[active])
        converging = less > MUCH * now.stats[:, 1]
        now.stats[:, 1] -= less
        _put(sums, active, now)
        if parts is not None:
            for m in np.flatnonzero(parts.at[active] >= 0):
                k = int(active[m])
                seen = model.differentiate(batch, k)
                if seen is not None:
                    sum_parts(batch, k, seen.after(stepped[m] - theta[k]), parts)
        moved = model.apply_h(stepped, normalised[active]) - model.apply_h(theta[active], normalised[active])
        theta[active] = stepped
        moved_px = np.abs(moved).max(axis=(1, 2)) * module_px[active]
        if step_no >= len(rules.free) - 1:
            active = active[~(moved_px < rules.stop_px) | converging | (thinned if step_no == 0 else False)]


def _explained(sums: Sums, step: Array) -> Array:
    """Return by how much a step lessens the sums of squared residuals (N,), by the linear model; at most by all."""
    less = 2 * np.einsum("ni,ni->n", step, sums.gradient) - np.einsum("ni,nij,nj->n", step, sums.normal, step)
    return np.asarray(np.clip(less, 0, MOST_EXPLAINED * sums.stats[:, 1]))


def _put(sums: Sums, at: Index, some: Sums) -> None:
    for all_tags, these in zip(sums, some, strict=True):
        all_tags[at] = these


def _step(sums: Sums, theta: Array, free: NDArray[np.bool_], damping: float) -> Array:
    normal, gradient = sums.normal.copy(), sums.gradient.copy()
    prior = kurtosis_prior(sums.stats)
    normal[:, KURTOSIS, KURTOSIS] += prior
    gradient[:, KURTOSIS] -= prior * theta[:, KURTOSIS]
    diagonal = np.einsum("nii->ni", normal)
    damp = np.where(diagonal > 1e-12, damping * diagonal, 1.0)
    normal += damp[:, :, None] * np.eye(PARAMETERS)
    step = np.zeros(gradient.shape)
    step[:, free] = np.linalg.solve(normal[:, free][:, :, free], gradient[:, free, None])[..., 0]
    return step


def _stepped(theta: Array, step: Array) -> Array:
    """Return the parameters after a step, held back where it would leave what the model can follow."""
    step = np.nan_to_num(step, nan=0.0, posinf=0.0, neginf=0.0)
    reach = np.abs(step[:, [2, 5]]).max(axis=1)
    held = np.minimum(1.0, LONGEST_MODULES / np.maximum(reach, 1e-12))
    step[:, :8] *= held[:, None]
    step[:, LOG_PSF] = np.clip(step[:, LOG_PSF], -LONGEST_LOG, LONGEST_LOG)
    new = theta + step
    new[:, KURTOSIS] = np.clip(new[:, KURTOSIS], *KURTOSIS_RANGE)
    new[:, LOG_PSF] = np.clip(new[:, LOG_PSF], *LOG_SIGMA_RANGE)
    return new
