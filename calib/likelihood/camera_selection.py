"""Which lens model the images ask for, by an information criterion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import FourSteps
from boxcal.calib.likelihood.estimate import Estimate
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.detect.correspondences import Correspondences
from boxcal.target.camera.camera_model import CameraKind, further_names


@dataclass(frozen=True, slots=True, kw_only=True)
class LensScore:
    """How one lens model does.

    Attributes
    ----------
    lens
        The model.
    coefficients
        How many it has beyond fu, fv, cu, cv.
    log_likelihood
        At its solution.
    bic
        Bayesian information criterion, ``k ln(n) - 2 ln L``; the least is best.
    """

    lens: CameraKind
    coefficients: int
    log_likelihood: float
    bic: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LensChoice:
    """The estimate with the best lens model, and how all did.

    Attributes
    ----------
    best
        The estimate.
    scores
        Of all models that could be solved, the best first.
    """

    best: Estimate
    scores: tuple[LensScore, ...]


def choose_lens(
    drives: Sequence[Correspondences],
    start: Sequence[FourSteps] | FourSteps | None = None,
    options: EstimateOptions | None = None,
    candidates: Sequence[CameraKind] = tuple(CameraKind),
) -> LensChoice:
    """Return the estimate with the lens model that has the least Bayesian information criterion.

    All candidates are compared on the same corners: none is left out while they compete (a model that does not fit
    would otherwise shed the corners that speak against it). A model that has no solution drops out.

    Parameters
    ----------
    drives, start, options
        As for :func:`boxcal.calib.likelihood.estimate`; the options' own lens does not matter.
    candidates
        Models to compare.

    Raises
    ------
    CalibError
        If no candidate can be solved.
    """
    options = options or EstimateOptions()
    count = 2 * sum(len(stop.landmark_ids) for drive in drives for stop in drive.stops)
    scores, problem = [], ""
    for lens in candidates:
        try:
            found = estimate(drives, start, replace(options, lens=lens, find_faults=False))
        except (CalibError, np.linalg.LinAlgError) as error:
            problem = str(error)
            continue
        coefficients = 1 + len(further_names(lens))
        scores.append(
            LensScore(
                lens=lens,
                coefficients=coefficients,
                log_likelihood=found.log_likelihood,
                bic=float(coefficients * np.log(count) - 2 * found.log_likelihood),
            )
        )
    if not scores:
        raise CalibError(f"no lens model can be solved: {problem}")
    scores.sort(key=lambda score: score.bic)
    return LensChoice(best=estimate(drives, start, replace(options, lens=scores[0].lens)), scores=tuple(scores))
