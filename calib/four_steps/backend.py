"""The one switch between step 1's compiled loops and their reference in numpy.

Every function has a twin of the same name and arguments in ``compiled/``; tests hold the twins together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec

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


def backend() -> Backend:
    """Return compiled code where numba is installed, else numpy."""
    return numpy_backend() if _NO_NUMBA else numba_backend()


_NO_NUMBA = find_spec("numba") is None


@cache
def numpy_backend() -> Backend:
    """Return the reference in numpy."""
    from boxcal.calib.four_steps import damped_step, reprojection_sums  # noqa: PLC0415 - as the other one

    return Backend(
        reprojection_sums=reprojection_sums.reprojection_sums,
        damped_step=damped_step.damped_step,
    )


@cache
def numba_backend() -> Backend:
    """Return compiled code, made before if it was not, once for all processes of a computer."""
    from boxcal.detect.alignment.compilation import finish  # noqa: PLC0415 - slow to import

    finish("boxcal.calib.four_steps.compiled.compilation")
    return loops()


def loops() -> Backend:
    """Return compiled code; each function is compiled, or read from the cache, when it is first called."""
    from boxcal.calib.four_steps.compiled import damped_step, reprojection_sums  # noqa: PLC0415 - slow to import

    return Backend(
        reprojection_sums=reprojection_sums.reprojection_sums,
        damped_step=damped_step.damped_step,
    )
