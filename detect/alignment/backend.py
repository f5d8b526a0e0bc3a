"""The one switch between compiled code and its reference in numpy.

Every function that is compiled has a twin of the same name and arguments: modules of ``numba/`` beside those of
``registration/`` and :mod:`boxcal.detect.alignment.box_refinement`. Tests hold the twins together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """The functions that take most of the time, compiled or in numpy.

    Attributes
    ----------
    name
        ``numba`` or ``numpy``.
    four_sided
        Outlines of tags, :func:`boxcal.detect.alignment.outlines.four_sided`.
    begin
        Start and pixels of an alignment, :func:`boxcal.detect.alignment.registration.begin.begin`.
    accumulate
        Normal equations of tags, :func:`boxcal.detect.alignment.registration.image_model.accumulate`.
    iterate
        Gauss-Newton steps, :func:`boxcal.detect.alignment.registration.gauss_newton.iterate`.
    finish
        Corners and covariances, :func:`boxcal.detect.alignment.registration.finish.finish`.
    sandwich_sums
        For what the model leaves out, :func:`boxcal.detect.alignment.registration.sandwich_sums.sandwich_sums`.
    levenberg_marquardt, predict
        The rigid box, :mod:`boxcal.detect.alignment.box_refinement`.
    widths, convex
        Shapes of tags, :mod:`boxcal.detect.alignment.tag_shape`.
    least_squares_homography
        :func:`boxcal.detect.alignment.homography.least_squares_homography`.
    undistort_locally
        Pixels on charts of a lens, :func:`boxcal.detect.alignment.radial_camera.undistort_locally`.
    """

    name: str
    four_sided: Callable[..., Any]
    begin: Callable[..., Any]
    accumulate: Callable[..., Any]
    iterate: Callable[..., None]
    finish: Callable[..., Any]
    sandwich_sums: Callable[..., Any]
    levenberg_marquardt: Callable[..., Any]
    predict: Callable[..., Any]
    widths: Callable[..., Any]
    convex: Callable[..., Any]
    least_squares_homography: Callable[..., Any]
    undistort_locally: Callable[..., Any]


@cache
def backend() -> Backend:
    """Return compiled code where numba is installed, else numpy."""
    return numpy_backend() if find_spec("numba") is None else numba_backend()


@cache
def numpy_backend() -> Backend:
    """Return the reference in numpy."""
    from boxcal.detect.alignment import (  # noqa: PLC0415 - these modules import this one
        box_refinement,
        homography,
        outlines,
        radial_camera,
        tag_shape,
    )
    from boxcal.detect.alignment.registration import (  # noqa: PLC0415
        begin,
        finish,
        gauss_newton,
        image_model,
        sandwich_sums,
    )

    return Backend(
        name="numpy",
        four_sided=outlines.four_sided,
        begin=begin.begin,
        accumulate=image_model.accumulate,
        iterate=gauss_newton.iterate,
        finish=finish.finish,
        sandwich_sums=sandwich_sums.sandwich_sums,
        levenberg_marquardt=box_refinement.levenberg_marquardt,
        predict=box_refinement.predict,
        widths=tag_shape.widths,
        convex=tag_shape.convex,
        least_squares_homography=homography.least_squares_homography,
        undistort_locally=radial_camera.undistort_locally,
    )


@cache
def numba_backend() -> Backend:
    """Return compiled code; each function is compiled, or read from the cache, when it is first called."""
    from boxcal.detect.alignment.numba import (  # noqa: PLC0415 - slow to import
        begin,
        box_refinement,
        finish,
        gauss_newton,
        homography,
        outlines,
        radial_camera,
        sandwich_sums,
        tag_shape,
    )

    return Backend(
        name="numba",
        undistort_locally=radial_camera.undistort_locally,
        least_squares_homography=homography.least_squares_homography,
        convex=tag_shape.convex,
        widths=tag_shape.widths,
        four_sided=outlines.four_sided,
        begin=begin.begin,
        accumulate=gauss_newton.accumulate,
        iterate=gauss_newton.iterate,
        finish=finish.finish,
        sandwich_sums=sandwich_sums.sandwich_sums,
        levenberg_marquardt=box_refinement.levenberg_marquardt,
        predict=box_refinement.predict,
    )
