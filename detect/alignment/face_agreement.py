"""Candidates that agree on where their face is: the largest set that one homography explains."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.backend import backend
from boxcal.detect.alignment.box_pose import FISHEYES
from boxcal.detect.alignment.candidates import TagCandidates
from boxcal.detect.alignment.homography import map_points
from boxcal.detect.alignment.radial_camera import fisheye_distortion, undistort_locally
from boxcal.detect.alignment.row_sets import among, distinct
from boxcal.target.arrays import Array
from boxcal.target.box import Target

CANDIDATE_TOLERANCE = 0.35
"""How far from the face's other tags a candidate may lie, tag sides."""
FACE_TAGS = 6
"""Number of tags that show a face."""
_ENOUGH = 0.8
"""Fraction of a face's candidates whose agreement ends the search for a larger one."""
_PAIRS = 24
_ALL_PAIRS = [np.triu_indices(count, 1) for count in range(13)]
_NEXT = np.array([1, 2, 3, 0])


def consistent_candidates(target: Target, candidates: TagCandidates, image_size: tuple[int, int]) -> TagCandidates:
    """Return the candidates that agree on where their face is, each tag once.

    On each face the largest set wins that one homography explains, as the image stands or, where many do not agree,
    on the charts of fisheyes. A tag seen in several places counts only where two other tags at least agree with one of
    them.
    """
    kept: list[int] = []
    twice: list[int] = []
    smaller: list[TagCandidates] = []
    faces = target.tag_faces[candidates.rows]
    for face in distinct(faces):
        at = np.flatnonzero(faces == face)
        here = candidates.take(at)
        agree = _largest_agreement(target, int(face), here)
        again = _second_sighting(target, int(face), here, agree)
        if again is not None:
            twice.append(int(face))
            kept += [int(k) for k in at[again[0]]]
            smaller.append(here.take(again[1]))
            continue
        for focal in FISHEYES:
            if agree.sum() >= _ENOUGH * len(at):
                break
            lens = fisheye_distortion(image_size, focal * max(image_size))
            normalisation = np.array([[*np.median(here.corners_px, axis=(0, 1)), 1.0]])
            charted = replace(here, corners_px=undistort_locally(lens, normalisation, here.corners_px[None])[0])
            other = _largest_agreement(target, int(face), charted)
            agree = other if other.sum() > agree.sum() else agree
        kept += [int(k) for k in at[agree]]
    chosen = np.array(kept, dtype=np.int64)
    rows = candidates.rows[chosen]
    once = candidates.take(chosen[np.bincount(rows)[rows] == 1])
    return replace(once, seen_twice=tuple(twice), again=tuple(smaller))


def _second_sighting(
    target: Target, face: int, candidates: TagCandidates, agree: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Return which candidates are the larger and the smaller sighting of a face; None if it is seen once."""
    rest = np.flatnonzero(~agree)
    if len(rest) < FACE_TAGS or agree.sum() < FACE_TAGS:
        return None
    other = rest[_largest_agreement(target, face, candidates.take(rest))]
    both = among(candidates.rows[other], candidates.rows[agree]).sum()
    if len(other) < FACE_TAGS or both < 0.5 * min(len(other), agree.sum()):
        return None
    second = np.zeros(len(candidates), dtype=np.bool_)
    second[other] = True
    sides = _mean_sides(candidates)
    return (second, agree) if np.median(sides[second]) > np.median(sides[agree]) else (agree, second)


def _largest_agreement(target: Target, face: int, candidates: TagCandidates) -> NDArray[np.bool_]:
    n = len(candidates)
    if n <= 1:
        return np.ones(n, dtype=np.bool_)
    T = target.T_box_face(face)
    p_face = ((target.tag_corners[candidates.rows] - T[:3, 3]) @ T[:3, :3])[..., :2]
    side = _mean_sides(candidates)
    best = np.zeros(n, dtype=np.bool_)
    for i, j in _pairs(candidates):
        if candidates.rows[i] == candidates.rows[j]:
            continue
        H = backend().least_squares_homography(
            np.concatenate([p_face[i], p_face[j]]), np.concatenate([candidates.corners_px[i], candidates.corners_px[j]])
        )
        apart = map_points(H, p_face) - candidates.corners_px
        off = np.hypot(apart[..., 0], apart[..., 1]).max(axis=1)
        agree = off < CANDIDATE_TOLERANCE * side  # not where a point has no image: NaN
        if agree.sum() > best.sum():
            best = agree
        if best.sum() >= _ENOUGH * n:
            break
    if best.sum() >= 3:
        return best
    # too few to judge: keep what is not contradicted by a second sighting
    return np.asarray(np.bincount(candidates.rows)[candidates.rows] == 1)


def _mean_sides(candidates: TagCandidates) -> Array:
    """Return the mean lengths (N,), px, of candidates' sides."""
    along = candidates.corners_px[:, _NEXT] - candidates.corners_px
    return np.asarray(0.25 * np.hypot(along[..., 0], along[..., 1]).sum(axis=1))


def _pairs(candidates: TagCandidates) -> Iterator[tuple[int, int]]:
    """Yield pairs of candidates to try, spread over the face: the best with those far away first."""
    order = np.argsort(-candidates.score)[:12]
    i, j = _ALL_PAIRS[len(order)]
    x, y = 0.25 * candidates.corners_px[order].sum(axis=1).T
    far = np.argsort(-np.hypot(x[i] - x[j], y[i] - y[j]), kind="stable")
    for pair in far[:: max(1, len(far) // _PAIRS)][:_PAIRS]:
        yield int(order[i[pair]]), int(order[j[pair]])
