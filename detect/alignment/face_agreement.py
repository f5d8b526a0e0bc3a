"""Candidates that agree on where their face is: the largest set that one homography explains."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from boxcal.detect.alignment.box_pose import FISHEYES
from boxcal.detect.alignment.candidates import TagCandidates
from boxcal.detect.alignment.homography import least_squares_homography, map_points
from boxcal.detect.alignment.radial_camera import fisheye_distortion, undistort_locally
from boxcal.target.box import Target

CANDIDATE_TOLERANCE = 0.35
"""How far from the face's other tags a candidate may lie, tag sides."""
FACE_TAGS = 6
"""So many tags show a face."""
_ENOUGH = 0.8
"""Fraction of a face's candidates whose agreement ends the search for a larger one."""
_PAIRS = 24


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
    for face in np.unique(faces):
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
    rows, count = np.unique(candidates.rows[chosen], return_counts=True)
    once = candidates.take(chosen[np.isin(candidates.rows[chosen], rows[count == 1])])
    return replace(once, seen_twice=tuple(twice), again=tuple(smaller))


def _second_sighting(
    target: Target, face: int, candidates: TagCandidates, agree: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Return which candidates are the larger and the smaller sighting of a face; None if it is seen once."""
    rest = np.flatnonzero(~agree)
    if len(rest) < FACE_TAGS or agree.sum() < FACE_TAGS:
        return None
    other = rest[_largest_agreement(target, face, candidates.take(rest))]
    both = np.isin(candidates.rows[other], candidates.rows[agree]).sum()
    if len(other) < FACE_TAGS or both < 0.5 * min(len(other), agree.sum()):
        return None
    second = np.zeros(len(candidates), dtype=np.bool_)
    second[other] = True
    sides = np.linalg.norm(candidates.corners_px - np.roll(candidates.corners_px, -1, axis=1), axis=2).mean(axis=1)
    return (second, agree) if np.median(sides[second]) > np.median(sides[agree]) else (agree, second)


def _largest_agreement(target: Target, face: int, candidates: TagCandidates) -> NDArray[np.bool_]:
    n = len(candidates)
    if n <= 1:
        return np.ones(n, dtype=np.bool_)
    T = target.T_box_face(face)
    p_face = ((target.tag_corners[candidates.rows] - T[:3, 3]) @ T[:3, :3])[..., :2]
    side = np.linalg.norm(candidates.corners_px - np.roll(candidates.corners_px, -1, axis=1), axis=2).mean(axis=1)
    best = np.zeros(n, dtype=np.bool_)
    for i, j in _pairs(candidates):
        if candidates.rows[i] == candidates.rows[j]:
            continue
        H = least_squares_homography(
            np.concatenate([p_face[i], p_face[j]]), np.concatenate([candidates.corners_px[i], candidates.corners_px[j]])
        )
        off = np.linalg.norm(map_points(H, p_face) - candidates.corners_px, axis=2).max(axis=1)
        agree = np.nan_to_num(off, nan=np.inf) < CANDIDATE_TOLERANCE * side
        if agree.sum() > best.sum():
            best = agree
        if best.sum() >= _ENOUGH * n:
            break
    if best.sum() >= 3:
        return best
    # too few to judge: keep what is not contradicted by a second sighting
    _, where, count = np.unique(candidates.rows, return_inverse=True, return_counts=True)
    return np.asarray(count[where] == 1)


def _pairs(candidates: TagCandidates) -> list[tuple[int, int]]:
    """Return pairs of candidates to try, spread over the face: the best with those far away first."""
    order = np.argsort(-candidates.score)[:12]
    i, j = np.triu_indices(len(order), 1)
    centre = candidates.corners_px[order].mean(axis=1)
    apart = np.linalg.norm(centre[i] - centre[j], axis=1)
    far = np.argsort(-apart, kind="stable")
    far = far[:: max(1, len(far) // _PAIRS)][:_PAIRS]
    return [(int(order[a]), int(order[b])) for a, b in zip(i[far], j[far], strict=True)]
