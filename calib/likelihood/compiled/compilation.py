"""The likelihood's loops called once each, so that they are compiled before they are needed.

    python -m boxcal.calib.likelihood.compiled.compilation [FOLDER]

compiles all code that is compiled, the detector's too; and puts it into a folder, as the build of a package does.
"""

import shutil
import sys
from pathlib import Path

import numpy as np

from boxcal.calib.four_steps.compiled import compilation as four_steps
from boxcal.calib.geometry.diff_drive import Legs
from boxcal.calib.likelihood.backend import loops
from boxcal.calib.likelihood.wheel_path import wheel_path
from boxcal.detect.alignment.compilation import PASSING, Tell, detector_folder, finish, prepare

_ESTIMATOR = (four_steps.__name__, "boxcal.calib.likelihood.compiled.compilation")
"""Modules with the estimator's code, in the order in which a robot needs it."""


def prepare_detector(tell: Tell) -> None:
    """Have the detector's code compiled, unless it is, and the estimator's begun; ``tell`` receives what takes long.

    Who needs the estimator's waits for it (:func:`boxcal.calib.likelihood.backend.numba_backend`).
    """
    prepare(tell, _ESTIMATOR)


def prepare_all(tell: Tell) -> None:
    """Have the detector's and the estimator's code compiled, unless it is; ``tell`` receives what takes long."""
    prepare(tell, _ESTIMATOR)
    for module in _ESTIMATOR:
        finish(module)


def compile_into(place: Path) -> None:
    """Have all compiled code copied to a place, once it is compiled and kept in the user's cache.

    Raises
    ------
    OSError
        If no folder can be written where it would be kept.
    """
    prepare_all(print)
    for kept in (detector_folder(), four_steps.cache_folder(), cache_folder()):
        if kept is None:
            raise OSError("no folder for compiled code can be written: neither the user's cache nor NUMBA_CACHE_DIR")
        shutil.copytree(kept, place / kept.name, ignore=shutil.ignore_patterns(*PASSING, "*.tmp.*"))


def cache_folder() -> Path | None:
    """Return the folder for the likelihood's compiled code; None if no place can be written."""
    from boxcal.calib.likelihood.compiled import kernel  # noqa: PLC0415 - slow to import

    return kernel.cache_folder()


def compile_all() -> None:
    """Compile every function, with the types of arguments that it is called with in use."""
    from boxcal.calib.likelihood.compiled import corners  # noqa: PLC0415 - slow to import

    compute = loops()
    D = np.eye(5)[None, None]
    right = np.ones((1, 1, 5, 2))
    pivots, gains, back, _ = compute.eliminate_stops(D, D, right)
    compute.substitute_back(gains, back)
    compute.chain_covariances(pivots, gains)
    path = wheel_path([Legs(dphi_R=np.ones(1), dphi_L=np.ones(1), ends=(0, 1))])
    compute.propagate(path, np.ones(3), np.zeros((1, 2)), np.zeros((1, 2)), None)
    one, pair = np.ones((1, 2)), np.ones((1, 2, 2))
    derivatives = np.ones((1, 2, 1)), np.ones((1, 2, 3)), np.ones((1, 3, 1))
    poses = np.ones((1, 3)), np.ones((1, 3, 3))
    corners.fill_rows(
        np.zeros(1, dtype=np.int64), (pair, one, one), derivatives, poses, one.copy(), np.empty((1, 2, 9))
    )
    compute.moved_points(np.ones((1, 3, 3)), np.ones((1, 3)), np.zeros(1, dtype=np.int64), np.ones((1, 3)))
    rows, first = (np.ones((1, 2, 3)), one, np.ones(1)), np.zeros(1, dtype=np.int64)
    compute.corner_sums(rows, first, first, 1, np.ones((1, 3, 4)), np.ones((1, 3, 2)))
    to = np.zeros((1, 3, 3)), np.zeros((1, 3)), np.zeros((1, 2, 5, 5)), np.zeros((1, 2, 5, 5)), np.zeros((1, 2, 5, 4))
    compute.add_legs(np.ones((1, 3, 13)), np.ones((1, 3)), np.ones((1, 1, 3, 3)), first, np.arange(3), to)
    compute.travelled(np.ones((2, 3, 1)), np.ones((1, 2, 1)), first)
    compute.inverses(D)
    compute.scaled_inverses(D)
    compute.scaled_determinants(D, np.ones((1, 1, 5)))
    chain = np.eye(2), np.ones((1, 2, 5)), D[0], np.ones(2), np.ones((1, 5))
    compute.without_local(
        chain, (D[0, :, :4, :4], np.ones((1, 2, 4)), np.ones((1, 5, 4)), np.ones((1, 4))), 1.0, *np.ones((2, 1, 4))
    )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        compile_into(Path(sys.argv[1]))
    else:
        prepare_all(print)
