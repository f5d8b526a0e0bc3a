"""The one switch between the likelihood's compiled loops and their reference in numpy.

Every function has a twin of the same name and arguments in ``compiled/``; tests hold the twins together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from types import ModuleType
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """The loops that take most of the time, compiled or in numpy.

    Attributes
    ----------
    eliminate_stops, substitute_back, chain_covariances
        Of :mod:`boxcal.calib.likelihood.chain`.
    propagate
        Of :mod:`boxcal.calib.likelihood.leg_propagation`.
    corner_rows
        Of :mod:`boxcal.calib.likelihood.corner_rows`.
    corner_sums, group_sums
        Of :mod:`boxcal.calib.likelihood.corner_sums`.
    moved_points
        Of :mod:`boxcal.calib.likelihood.moved_points`.
    add_legs, travelled
        Of :mod:`boxcal.calib.likelihood.leg_sums`.
    inverses, scaled_inverses, scaled_determinants
        Of :mod:`boxcal.calib.likelihood.small_matrices`.
    without_local
        Of :mod:`boxcal.calib.likelihood.local_elimination`.
    """

    eliminate_stops: Callable[..., Any]
    substitute_back: Callable[..., None]
    chain_covariances: Callable[..., Any]
    propagate: Callable[..., tuple[Any, ...]]
    corner_rows: Callable[..., tuple[Any, Any]]
    corner_sums: Callable[..., tuple[Any, ...]]
    group_sums: Callable[..., Any]
    moved_points: Callable[..., Any]
    add_legs: Callable[..., None]
    travelled: Callable[..., Any]
    inverses: Callable[..., tuple[Any, Any]]
    scaled_inverses: Callable[..., tuple[Any, Any, float]]
    scaled_determinants: Callable[..., tuple[Any, Any, float]]
    without_local: Callable[..., tuple[Any, Any, float, float]]


def backend() -> Backend:
    """Return compiled code where numba is installed, else numpy."""
    return numpy_backend() if _NO_NUMBA else numba_backend()


_NO_NUMBA = find_spec("numba") is None


@cache
def numpy_backend() -> Backend:
    """Return the reference in numpy."""
    from boxcal.calib.likelihood import (  # noqa: PLC0415 - as the other one
        chain,
        corner_rows,
        corner_sums,
        leg_propagation,
        leg_sums,
        local_elimination,
        moved_points,
        small_matrices,
    )

    return _of(
        chain, leg_propagation, corner_rows, corner_sums, moved_points, leg_sums, small_matrices, local_elimination
    )


@cache
def numba_backend() -> Backend:
    """Return compiled code, made before if it was not, once for all processes of a computer."""
    from boxcal.detect.alignment.compilation import finish  # noqa: PLC0415 - slow to import

    finish("boxcal.calib.likelihood.compiled.compilation")
    return loops()


def loops() -> Backend:
    """Return compiled code; each function is compiled, or read from the cache, when it is first called."""
    from boxcal.calib.likelihood.compiled import (  # noqa: PLC0415 - slow to import
        chain,
        corner_sums,
        corners,
        leg_sums,
        legs,
        local_elimination,
        moved_points,
        small_matrices,
    )

    return _of(chain, legs, corners, corner_sums, moved_points, leg_sums, small_matrices, local_elimination)


def _of(  # noqa: PLR0917 - one for each
    chain: ModuleType,
    legs: ModuleType,
    corners: ModuleType,
    sums: ModuleType,
    points: ModuleType,
    of_legs: ModuleType,
    small: ModuleType,
    local: ModuleType,
) -> Backend:
    return Backend(
        eliminate_stops=chain.eliminate_stops,
        substitute_back=chain.substitute_back,
        chain_covariances=chain.chain_covariances,
        propagate=legs.propagate,
        corner_rows=corners.corner_rows,
        corner_sums=sums.corner_sums,
        group_sums=sums.group_sums,
        moved_points=points.moved_points,
        add_legs=of_legs.add_legs,
        travelled=of_legs.travelled,
        inverses=small.inverses,
        scaled_inverses=small.scaled_inverses,
        scaled_determinants=small.scaled_determinants,
        without_local=local.without_local,
    )
