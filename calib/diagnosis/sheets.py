"""Arrangement of the sheets on the box (face and orientation), estimated from views of two faces at once.

A sheet's pose in an image needs no other sheet, so two sheets in one image show how one lies against the other. All
orders of the sheets, each upright or upside down, are compared with that; turning the whole box changes nothing and is
passed over.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import cv2
import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.zhang_init import MIN_POINTS, camera_matrix_guesses, face_homographies
from boxcal.calib.geometry.so3_se3 import inverse, rigid, rot_z
from boxcal.calib.likelihood.finding import Finding
from boxcal.detect.correspondences import StopObservation
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target

FITS_DEG = 15.0
"""Two sheets fit an order if their poses differ no more than this from it; planar poses err by a few degrees."""
MISFITS_DEG = 30.0
"""The order as described is doubted where it is further off than this, on average."""
MIN_VIEWS = 2
"""Views of two sheets at once that an order must rest on."""
_DEG_A_METRE = 100.0
"""Weight of distances beside angles: 0.1 m counts as 10 deg."""
_CAP_DEG = 90.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Gluing:
    """Arrangement of the sheets: the face that each is on, and its orientation.

    Attributes
    ----------
    face
        Face that carries each sheet.
    turned
        Whether each sheet is upside down.
    misfit_deg, described_deg
        Mean difference of the sheets' poses from this gluing, and from the one described.
    views
        Pairs of sheets seen at once that it rests on.
    """

    face: tuple[int, ...]
    turned: tuple[bool, ...]
    misfit_deg: float = 0.0
    described_deg: float = 0.0
    views: int = 0

    @property
    def as_described(self) -> bool:
        """Whether every sheet is where it belongs."""
        return self.face == tuple(range(FACES)) and not any(self.turned)

    def target(self, target: Target) -> Target:
        """Return the landmarks where this gluing has them; what a fleet refined was of a box as described."""
        target = target.unrefined
        corners, faces = target.tag_corners.copy(), target.tag_faces.copy()
        for sheet in range(FACES):
            rows = target.tag_faces == sheet
            T = _pose(target, self.face[sheet], self.turned[sheet]) @ inverse(target.T_box_face(sheet))
            corners[rows] = target.tag_corners[rows] @ T[:3, :3].T + T[:3, 3]
            faces[rows] = self.face[sheet]
        return replace(target, tag_corners=corners, tag_faces=faces)

    def finding(self, why: str = "") -> Finding:
        """Return it in words; why it is believed, where no views of two faces show it."""
        moved = [s for s in range(FACES) if self.face[s] != s]
        words = []
        if len(moved) == 2 and (moved[1] - moved[0]) % 2 == 0:
            rest = [s for s in range(FACES) if s not in moved]
            words.append(
                f"sheets {moved[0]} and {moved[1]} are swapped (or {rest[0]} and {rest[1]}: the sheets run round the "
                "box in reverse order)"
            )
        elif len(moved) == 2:
            words.append(f"sheets {moved[0]} and {moved[1]} are swapped")
        elif moved:
            order = ", ".join(str(self.face.index(f)) for f in range(FACES))
            words.append(f"faces 0 to {FACES - 1} carry sheets {order}")
        upside = [str(s) for s in range(FACES) if self.turned[s]]
        if upside:
            words.append(
                f"sheet {upside[0]} is glued upside down"
                if len(upside) == 1
                else f"sheets {', '.join(upside[:-1])} and {upside[-1]} are glued upside down"
            )
        cause = "sheets-upside-down" if not moved else "sheets-swapped"
        why = why or (
            f"{self.views} views of two faces at once fit that to {self.misfit_deg:.1f} deg, the box as described to "
            f"{self.described_deg:.0f} deg"
        )
        return Finding(
            cause=cause,
            text=f"{' and '.join(words)}: {why}; the landmarks were taken where they are",
            advice="Glue the sheets as the assembly guide shows, or keep this box for this fleet only.",
            adopted=True,
        )


def find_gluing(stops: Sequence[StopObservation], image_size: tuple[int, int], target: Target) -> Gluing | None:
    """Return where the sheets are; None if too few views show two of them at once, or nothing fits.

    Parameters
    ----------
    stops
        What was seen.
    image_size : px
        Width and height.
    target
        The box as described.
    """
    try:
        homographies = face_homographies(stops)
        if not homographies:
            return None
        K = camera_matrix_guesses(homographies, image_size)[-1]
    except CalibError:
        return None
    pairs = _pairs(stops, K, target)
    count = sum(len(seen) for seen in pairs.values())
    if count < MIN_VIEWS:
        return None
    described = sum(_cost_as_described(pair, seen, target) for pair, seen in pairs.items()) / count
    if described < MISFITS_DEG:
        return Gluing(
            face=tuple(range(FACES)),
            turned=(False,) * FACES,
            misfit_deg=described,
            described_deg=described,
            views=count,
        )
    costs = {pair: _costs(seen, target) for pair, seen in pairs.items()}

    def cost(face: tuple[int, ...], turned: tuple[int, ...]) -> float:
        return sum(float(c[face[a], face[b], turned[a], turned[b]]) for (a, b), c in costs.items()) / count

    every = product(permutations(range(FACES)), product((0, 1), repeat=FACES))
    found = [(cost(face, turned), face, turned) for face, turned in every]
    least = min(c for c, _, _ in found)
    if least > FITS_DEG:
        return None
    _, face, turned = min(
        (f for f in found if f[0] < least + 1.0),
        key=lambda f: (_moved(f[1]) + 1.5 * sum(f[2]), [s for s in range(FACES) if f[1][s] != s]),
    )
    return Gluing(
        face=face, turned=tuple(bool(t) for t in turned), misfit_deg=least, described_deg=described, views=count
    )


def _moved(face: tuple[int, ...]) -> int:
    return sum(f != sheet for sheet, f in enumerate(face))


def _pose(target: Target, face: int, turned: int) -> Array:
    return target.T_box_face(face) @ rigid(rot_z(np.pi * turned), np.zeros(3))


def _pairs(stops: Sequence[StopObservation], K: Array, target: Target) -> dict[tuple[int, int], list[list[Array]]]:
    """Return what each image says of T_sheet_sheet for each pair of sheets: all solutions of the planar poses."""
    pairs: dict[tuple[int, int], list[list[Array]]] = defaultdict(list)
    T_sheet_box = [inverse(target.T_box_face(sheet)) for sheet in range(FACES)]
    for stop in stops:
        on_sheet, p_box = target.faces(stop.landmark_ids), target.p_box(stop.landmark_ids)
        sheets = {}
        seen = np.flatnonzero(np.bincount(on_sheet, minlength=FACES) >= MIN_POINTS).tolist()
        for sheet in seen if len(seen) > 1 else ():
            on, T = on_sheet == sheet, T_sheet_box[sheet]
            sheets[sheet] = _planar_poses(p_box[on] @ T[:3, :3].T + T[:3, 3], stop.uv_px[on], K)
        for a, b in combinations(sorted(sheets), 2):
            both = [inverse(A) @ B for A in sheets[a] for B in sheets[b]]
            if both:
                pairs[a, b].append(both)
    return pairs


def _planar_poses(p: Array, uv_px: Array, K: Array) -> list[Array]:
    """Return both poses that fit a planar view, T_cam_sheet."""
    flat = p * (1.0, 1.0, 0.0)
    _, rotations, translations, _ = cv2.solvePnPGeneric(flat, uv_px, K, None, flags=cv2.SOLVEPNP_IPPE)
    poses = [
        rigid(np.asarray(cv2.Rodrigues(r)[0], dtype=np.float64), np.asarray(t, dtype=np.float64).ravel())
        for r, t in zip(rotations, translations, strict=True)
    ]
    return [T for T in poses if np.all(np.isfinite(T)) and T[2, 3] > 0]


def _cost_as_described(pair: tuple[int, int], seen: list[list[Array]], target: Target) -> float:
    """Return the angular residual, deg, summed over views, of a pair of sheets that are where they should be."""
    first, second = (_pose(target, face, 0) for face in pair)
    T = inverse(first) @ second
    return sum(float(np.min(_difference(np.array(views), T))) for views in seen)


def _costs(seen: list[list[Array]], target: Target) -> Array:
    """Return the angular residual, deg, summed over views, by faces and orientations: (FACES, FACES, 2, 2)."""
    out = np.full((FACES, FACES, 2, 2), _CAP_DEG * len(seen))
    poses = np.array([[_pose(target, face, up) for up in (0, 1)] for face in range(FACES)])
    T = inverse(poses)[:, None, :, None] @ poses[None, :, None, :]  # (FACES, FACES, 2, 2, 4, 4)
    each = [np.min([_difference(T, view) for view in views], axis=0) for views in seen]
    apart = ~np.eye(FACES, dtype=bool)
    out[apart] = np.sum(each, axis=0)[apart]
    return out


def _difference(T: Array, seen: Array) -> Array:
    """Return how far poses (..., 4, 4) are from one, deg, distances counted in."""
    cosine = (np.einsum("...ij,ij->...", T[..., :3, :3], seen[:3, :3]) - 1) / 2
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    off = np.linalg.norm(T[..., :3, 3] - seen[:3, 3], axis=-1)
    return np.asarray(np.minimum(angle + _DEG_A_METRE * off, _CAP_DEG))
