"""Find the tags of a target in an image, their corners at the noise limit: the steps in their order."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_pose import LEAST_SIGMA_PX, BoxFit, CameraPrior, fit_box
from boxcal.detect.alignment.box_search import BoxDetection
from boxcal.detect.alignment.covariance import inflation_left_out, rigid_share
from boxcal.detect.alignment.cut_tags import carried_to_lens, cut_by_border
from boxcal.detect.alignment.deformation.deformed_tags import deformation, looks_deformed, with_field_of_few
from boxcal.detect.alignment.deformation.kriging import Deformation
from boxcal.detect.alignment.detection import DetectorOutput, DetectorSettings, KnownCamera, nothing
from boxcal.detect.alignment.dot_gain import without_dot_gain
from boxcal.detect.alignment.expected_tags import ExpectedTags, at_most, find_expected
from boxcal.detect.alignment.face_scatter import ENOUGH, scatter
from boxcal.detect.alignment.fine_alignment import FINE_SIDE_PX, align_finely, aligned_again, believed, on_the_box
from boxcal.detect.alignment.motion_blur import estimate_blur, shape, shape_of
from boxcal.detect.alignment.preview import Preview, preview
from boxcal.detect.alignment.pyramid import Pyramid, align_coarsely
from boxcal.detect.alignment.pyramid_search import FEW_TAGS, find_box, search_copies
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration.parameters import KURTOSIS
from boxcal.detect.alignment.registration.tag_alignments import TagAlignments
from boxcal.detect.alignment.registration.tag_batch import ROUND, Frame
from boxcal.detect.alignment.row_sets import among
from boxcal.detect.alignment.tag_curvature import sagitta_difference_px, under_lens
from boxcal.detect.alignment.tag_patterns import Index, Patterns, target_patterns
from boxcal.detect.alignment.uneven_light import displacement_px2
from boxcal.detect.alignment.verification import verified
from boxcal.detect.image.gray import Levels, to_grey8, to_levels
from boxcal.detect.image.order_statistics import median
from boxcal.detect.image.response_curve import ResponseEstimate, estimate_response, response_table
from boxcal.target.box import Target

MODEL_ERROR_PX = 0.001
"""Deviation per axis of what the model leaves out (lens, print, pixel response); no residual shows it."""
BENT_PX = 0.05
"""If the lens that the aligned tags tell moves the middle of an edge by more than this against the corners, tags are
aligned again under it; else their corners are carried over (:mod:`boxcal.detect.alignment.tag_curvature`)."""
MOVED, MOVED_MORE = 1.0, 1.5
"""Variance inflation beyond which the tags are asked whether the picture moved: as a value, and as a multiple of the
largest at which pictures of the same camera at rest were found not to."""


def detect_tags(
    image: NDArray[np.generic],
    target: Target,
    settings: DetectorSettings | None = None,
    *,
    camera: KnownCamera | None = None,
    expected: ExpectedTags | None = None,
) -> DetectorOutput:
    """Return the target's tags in an image.

    Every tag is used that lies wholly in the image, on a face turned to the camera, wide enough to be read (about six
    pixels across); tags that are covered, glared, mirrored, out of place on the rigid box, or seen twice are not.

    Parameters
    ----------
    image : (H, W) or (H, W, 3)
        Grey or BGR; uint8, uint16 (white at 65535; of fewer bits see :mod:`boxcal.detect.image.bit_depth`) or float
        (full scale 1).
    target
        The box to look for.
    settings
        The defaults if None.
    camera
        What an earlier picture of the same camera told of it (``camera`` of its result).
    expected
        Where tags should be, to about a module: the rest of the picture is searched only where they are not there.
        Neither is used by a preview.

    Raises
    ------
    DetectError
        If that is no image.

    Examples
    --------
    >>> import boxcal, cv2
    >>> found = boxcal.detect_tags(cv2.imread("photo.png"), boxcal.make_target())
    >>> found.corners_px.shape == (len(found.ids), 4, 2)
    True
    """
    settings = settings or DetectorSettings()
    patterns = target_patterns(target)
    if settings.fast:
        return _previewed(patterns, preview(to_grey8(image), target, settings.response, settings.windows_px[0]))
    return detect_in_grey(*to_levels(image), target, settings, camera, expected)


def detect_in_grey(  # noqa: PLR0917
    grey: Levels,
    grey8: NDArray[np.uint8],
    target: Target,
    settings: DetectorSettings,
    camera: KnownCamera | None = None,
    expected: ExpectedTags | None = None,
) -> DetectorOutput:
    """Return the target's tags in grey levels (H, W) and their copy in 8 bits.

    Where the camera is known from other pictures, the search is for the box alone; where tags are expected, they are
    looked for there first. For the rest see :func:`detect_tags`; a preview is not made.
    """
    patterns = target_patterns(target)
    size = (grey.shape[1], grey.shape[0])
    pyramid = Pyramid(grey, response_table(_first_response(settings, camera)), no_distortion(size))
    found = _searched(pyramid, grey8, target, settings, None if camera is None else camera.prior, expected)
    if found is None:
        return nothing(_first_response(settings, camera))
    tags, fit = found.tags, found.fit
    frame = replace(pyramid.level(0), lens=fit.lens, blur=ROUND if expected is None else shape(*expected.blur))
    if camera and camera.imaging.settled:
        taken = ResponseEstimate(imaging=camera.imaging, darkness=None)
    else:
        taken = estimate_response(frame, patterns, tags, settings.response)
    frame, tags = align_finely(frame, patterns, tags, taken)
    there = believed(frame, target, patterns, tags, fit, settings.limits)
    tags, uneven = on_the_box(target, patterns, there.tags, fit), there.uneven
    inflation, rounded = _inflation(frame, patterns, tags, uneven), 0.0 if camera is None else camera.round_inflation
    if inflation > max(MOVED, MOVED_MORE * rounded):
        blur = estimate_blur(frame, patterns, tags)
        if blur is None:
            rounded = inflation
        else:
            better = replace(frame, blur=blur)
            tags, own = aligned_again(frame, better, target, patterns, tags, there.own_light, fit)
            tags = tags.joined(own)
            frame = better
            inflation = _inflation(frame, patterns, tags, uneven)
    tags = without_dot_gain(patterns, tags, uneven)
    fit = _fitted(target, patterns, tags, size, fit)
    moved, deformed = looks_deformed(patterns, tags, uneven), None
    if moved or sagitta_difference_px(frame.lens, fit.lens, tags.corners_px) > BENT_PX:
        better = replace(frame, lens=fit.lens)
        tags, own = aligned_again(frame, better, target, patterns, tags, there.own_light, fit, every=moved)
        tags = without_dot_gain(patterns, tags, uneven).joined(own)
        frame = better
        deformed = deformation(target, patterns, tags, uneven, frame.lens, fit) if moved else None
    if deformed is not None:
        tags, inflation = replace(tags, corners_px=tags.corners_px + deformed.displacement_px), deformed.noise_factor
        fit = _fitted(target, patterns, tags, size, fit)
    if len(uneven) and len(tags):
        displaced = displacement_px2(target, tags, fit, among(tags.rows, uneven))
        tags = replace(tags, cov_px2=tags.cov_px2 + displaced[:, None, None, None] * np.eye(2))
    located = replace(
        _located(frame, patterns, with_field_of_few(patterns, tags), inflation, deformed),
        contradicting_faces=found.contradicting_faces,
        rejected_ids=np.sort(patterns.tag_ids[found.off_the_box(target, fit, tags.rows, size)]),
    )
    located = _under_lens(located, patterns, frame, fit, flat=deformed is None)
    located = _with_faces(located, target, fit, uneven, flat=deformed is None)
    if len(tags) < FEW_TAGS:
        return located
    imaging = replace(taken.imaging, kurtosis=median(tags.theta[:, KURTOSIS]))
    return replace(located, camera=KnownCamera(prior=fit.camera(max(size)), imaging=imaging, round_inflation=rounded))


def _searched(  # noqa: PLR0917
    pyramid: Pyramid,
    grey8: NDArray[np.uint8],
    target: Target,
    settings: DetectorSettings,
    camera: CameraPrior | None,
    expected: ExpectedTags | None,
) -> BoxDetection | None:
    """Return the tags of one box, roughly aligned: where they are expected, or wherever they are; None without any."""
    patterns, limits = target_patterns(target), settings.limits
    if expected is not None:
        found = find_expected(pyramid, target, patterns, expected, limits, camera)
        if found is not None or expected.alone:
            return found
    found = find_box(pyramid, grey8, target, patterns, windows_px=settings.windows_px, limits=limits, camera=camera)
    return found if found is None or expected is None else at_most(found, expected.most)


def _fitted(target: Target, patterns: Patterns, tags: TagAlignments, size: tuple[int, int], start: BoxFit) -> BoxFit:
    """Return the box fitted to tags: those that the border does not cut, where they are enough."""
    if len(tags) < FEW_TAGS:
        return start
    whole = ~cut_by_border(patterns, tags.corners_px, size)
    some = tags.take(whole) if np.sum(whole) >= max(FEW_TAGS, 0.5 * len(tags)) else tags
    return fit_box(target, some.rows, some.corners_px, image_size=size, sigma_px=LEAST_SIGMA_PX, start=start)


def _under_lens(
    located: DetectorOutput, patterns: Patterns, frame: Frame, fit: BoxFit, *, flat: bool
) -> DetectorOutput:
    """Return tags with corners under the box's lens; where paper is not flat, blocks told what that changes, too."""
    size = (frame.grey.shape[1], frame.grey.shape[0])
    corners = under_lens(frame.lens, fit.lens, located.corners_px) if flat else located.corners_px.copy()
    cov = located.cov_px2
    cut = cut_by_border(patterns, located.corners_px, size)
    if cut.any():
        cov = cov.copy()
        corners[cut], added = carried_to_lens(frame.lens, fit, located.corners_px[cut], size)
        cov[cut] += added
    return replace(located, corners_px=corners, cov_px2=cov)


def _with_faces(located: DetectorOutput, target: Target, fit: BoxFit, uneven: Index, *, flat: bool) -> DetectorOutput:
    """Return the tags with covariances as large as their faces show them to be.

    No larger where the paper is not flat, as then tags really differ in shape; and no larger than the whole box shows
    them to be where too few tags of any face are seen.
    """
    rows = np.array([target.row_of(int(tag)) for tag in located.ids], dtype=np.int64)
    uv = fit.places(target.tag_corners[rows].reshape(-1, 3))
    apart = located.corners_px - uv.reshape(-1, 4, 2)
    factor, freedom = scatter(target, rows, apart, located.cov_px2, among(rows, uneven))
    if freedom < ENOUGH:
        factor = np.full(len(rows), rigid_share(apart, located.cov_px2, len(fit.information)))
    elif not flat:
        factor = np.minimum(factor, 1.0)
    return replace(located, cov_px2=factor[:, None, None, None] * located.cov_px2)


def _first_response(settings: DetectorSettings, camera: KnownCamera | None) -> str:
    """Return the response curve under which a picture is searched."""
    if settings.response != "auto":
        return settings.response
    return "linear" if camera is None else camera.imaging.response


def detect_copies(
    image: NDArray[np.generic], patterns: Patterns, settings: DetectorSettings | None = None
) -> DetectorOutput:
    """Return every sighting of some tags in an image, whatever they are stuck on; an id may come back several times.

    There is no box to predict from, so only tags are found that stand out by themselves; nor a sheet that is known to
    be flat and evenly lit, so the limits are relaxed. Arguments and errors as for
    :func:`detect_tags`.
    """
    settings = settings or DetectorSettings()
    limits = settings.limits.relaxed()
    grey, grey8 = to_levels(image)
    candidates = search_copies(grey8, patterns, settings.windows_px)
    pyramid = Pyramid(grey, response_table("linear"), no_distortion((grey.shape[1], grey.shape[0])))
    tags = align_coarsely(pyramid, patterns, candidates.rows, candidates.corners_px)
    frame = pyramid.level(0)
    tags = tags.take(verified(patterns, tags, limits.relaxed()))
    frame, tags = align_finely(frame, patterns, tags, estimate_response(frame, patterns, tags, settings.response))
    tags = tags.take(verified(patterns, tags, limits))
    inflation = inflation_left_out(frame, patterns, tags, FINE_SIDE_PX)
    # the same pattern again and again: what displaces blocks alike in all may be ink or the response curve
    return _located(frame, patterns, tags, inflation, None)


def _previewed(patterns: Patterns, seen: Preview) -> DetectorOutput:
    order = np.argsort(patterns.tag_ids[seen.rows], kind="stable")
    n = len(order)
    return DetectorOutput(
        ids=patterns.tag_ids[seen.rows[order]],
        corners_px=seen.corners_px[order],
        cov_px2=np.broadcast_to(seen.sigma_px[order, None, None, None] ** 2 * np.eye(2), (n, 4, 2, 2)).copy(),
        correlation=np.full(n, np.nan),
        blur_px=np.full(n, np.nan),
        residual=np.full(n, np.nan),
        response=seen.response,
    )


def _inflation(frame: Frame, patterns: Patterns, tags: TagAlignments, uneven: Index) -> float:
    """Return the inflation of the variances by what the model leaves out, by evenly lit tags where there are enough."""
    even = tags.take(~among(tags.rows, uneven))
    return inflation_left_out(frame, patterns, even if len(even) >= FEW_TAGS else tags, FINE_SIDE_PX)


def _located(
    frame: Frame, patterns: Patterns, tags: TagAlignments, inflation: float, deformed: Deformation | None
) -> DetectorOutput:
    cov = inflation * tags.cov_px2 + MODEL_ERROR_PX**2 * np.eye(2)
    if deformed is not None:
        cov += deformed.cov_px2
    order = np.argsort(patterns.tag_ids[tags.rows], kind="stable")
    tags = tags.take(order)
    return DetectorOutput(
        ids=patterns.tag_ids[tags.rows],
        corners_px=tags.corners_px,
        cov_px2=cov[order],
        correlation=tags.correlation,
        blur_px=tags.psf_sigma_px,
        blur_shape=shape_of(frame.blur),
        residual=tags.noise,
        response="srgb" if frame.response is response_table("srgb") else "linear",
    )
