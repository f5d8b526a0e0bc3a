"""Step 1's loops called once each, so that they are compiled before they are needed."""

from pathlib import Path

import numpy as np

from boxcal.calib.four_steps.backend import loops


def cache_folder() -> Path | None:
    """Return the folder for step 1's compiled code; None if no place can be written."""
    from boxcal.calib.four_steps.compiled import kernel  # noqa: PLC0415 - slow to import

    return kernel.cache_folder()


def compile_all() -> None:
    """Compile every function, with the types of arguments that it is called with in use."""
    compute = loops()
    compute.reprojection_sums(np.ones(5), np.eye(4)[None], np.ones((1, 3)), np.ones((1, 2)), np.array([0, 1]))
    compute.damped_step(np.eye(12)[None], 0.0, np.eye(4)[None])
