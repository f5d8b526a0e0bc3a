"""The faces as tag grids in the manner of Kalibr's ``aprilgrid`` YAML, where that form can say them exactly.

Kalibr itself reads tags with a black border of two modules and counts ids from the bottom left, rows upward; OpenCV's
families have one module and the box counts from the top left, rows downward. So the files also list every id, by rows
from the bottom as Kalibr has them, for tools that take other borders and orders.
"""

from collections.abc import Mapping

import numpy as np

from boxcal.target.box import FACES, Target
from boxcal.target.errors import TargetError
from boxcal.target.files.target_json import target_sha256

EXACT_M = 1e-6
"""How far a corner may lie from the regular grid, m: more, and the grid would not say where it is."""


def face_grid_yaml(target: Target, face: int) -> bytes:
    """Return a face's grid as YAML, lengths in m.

    Its frame: origin at the outer bottom left corner of the bottom left tag, x to the right, y up, z outward; its pose
    on the box is given as ``T_box_grid``.

    Raises
    ------
    TargetError
        If the face's tags do not form one grid of equal squares at equal distances, as in a print that is scaled
        differently along and across: Kalibr's form has one size and one spacing.
    """
    box = target.box
    rows = np.flatnonzero(target.tag_faces == face)
    if len(rows) != box.tags_a_face:
        raise TargetError(
            f"face {face}: {len(rows)} tags, a full grid has {box.tags_a_face}", remedy="use another face"
        )
    corners = target.tag_corners[rows].reshape(box.rows, box.columns, 4, 3)[::-1]
    design = np.column_stack([box.grid_corners().reshape(-1, 2), np.zeros(4 * len(rows))])
    design = design.reshape(box.rows, box.columns, 4, 3)[::-1]
    design = design - design[0, 0, 3]
    scale, R, t = _similarity(design.reshape(-1, 3), corners.reshape(-1, 3))
    off = np.linalg.norm(scale * design.reshape(-1, 3) @ R.T + t - corners.reshape(-1, 3), axis=1).max()
    if off > EXACT_M:
        raise TargetError(
            f"face {face}: its tags lie up to {off * 1e3:.3g} mm off a regular grid (a print scaled differently along "
            "and across?), Kalibr's form needs one size and one spacing",
            remedy="use target.json",
        )
    ids = target.tag_ids[rows].reshape(box.rows, box.columns)[::-1]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    lines = [
        f"# Face {face} of a landmark box, target {target_sha256(target)[:12]}; lengths in m.",
        "# Ids count from the top left, rows downward; black borders are one module wide (Kalibr's own are two and its",
        "# ids count from the bottom left): give tagIds to tools that take them, do not rely on an order.",
        "target_type: 'aprilgrid'",
        f"tagCols: {box.columns}",
        f"tagRows: {box.rows}",
        f"tagSize: {scale * box.tag_size:.9g}",
        f"tagSpacing: {(box.pitch - box.tag_size) / box.tag_size:.9g}",
        f"tagFamily: '{box.dictionary.removeprefix('DICT_')}'",
        "borderBits: 1",
        "tagIds:  # rows from the bottom, each from the left",
        *(f"  - [{', '.join(str(i) for i in row)}]" for row in ids),
        "T_box_grid:",
        *(f"  - [{', '.join(f'{v + 0.0:.9g}' for v in np.round(row, 12))}]" for row in T),
    ]
    return ("\n".join(lines) + "\n").encode()


def face_grids(target: Target) -> Mapping[str, bytes]:
    """Return the YAML of every face that it can say exactly, and a note on those it cannot: file name -> content."""
    files, left_out = {}, []
    for face in range(FACES):
        try:
            files[f"face-{face}.yaml"] = face_grid_yaml(target, face)
        except TargetError as error:
            left_out.append(str(error))
    if left_out:
        files["left-out.txt"] = ("\n".join(left_out) + "\n").encode()
    return files


def _similarity(p: np.ndarray, q: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return scale, rotation (3, 3) and translation (3,) that take p (N, 3) to q best (Umeyama 1991, eq. 40 to 42).

    DOI 10.1109/34.88573. Points on a line leave the rotation about it open.
    """
    p0, q0 = p.mean(axis=0), q.mean(axis=0)
    U, d, Vt = np.linalg.svd((q - q0).T @ (p - p0) / len(p))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = (U * sign) @ Vt
    scale = float((d * sign).sum() / ((p - p0) ** 2).sum(axis=1).mean())
    return scale, R, q0 - scale * R @ p0
