"""The one switch between step 1's compiled loops and their reference in numpy.

Every function has a twin of the same name and arguments in ``compiled/``; tests hold the twins together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from types import ModuleType

from boxcal.target.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """The loops that take most of step 1's time, compiled or in numpy.

    Attributes
    ----------
    reprojection_sums
        Of :mod:`boxcal.calib.four_steps.reprojection_sums`.
    damped_step
        Of :mod:`boxcal.calib.four_steps.damped_step`.
    """

    reprojection_sums: Callable[..., Array]
    damped_step: Callable[..., tuple[Array, Array, float]]


@cache
def backend() -> Backend:
    """Return compiled code where numba is installed, made before if it was not, else numpy."""
    if find_spec("numba") is None:
        return reference()
    from boxcal.detect.alignment.compilation import finish  # noqa: PLC0415 - slow to import

    finish("boxcal.calib.four_steps.compiled.compilation")
    return loops()


def reference() -> Backend:
    """Return the loops in numpy."""
    from boxcal.calib.four_steps import damped_step, reprojection_sums  # noqa: PLC0415 - as the other one

    return _of(damped_step, reprojection_sums)


def loops() -> Backend:
    """Return compiled code; each function is compiled, or read from the cache, when it is first called."""
    from boxcal.calib.four_steps.compiled import damped_step, reprojection_sums  # noqa: PLC0415 - slow to import

    return _of(damped_step, reprojection_sums)


def _of(step: ModuleType, sums: ModuleType) -> Backend:
    return Backend(reprojection_sums=sums.reprojection_sums, damped_step=step.damped_step)
