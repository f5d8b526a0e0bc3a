"""The landmark box: sizes, tag grids and the landmark table."""

from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np

from boxcal.target.arrays import Array, Ids
from boxcal.target.errors import TargetError
from boxcal.target.measure.measured_size import Measured, check_credible
from boxcal.target.measure.refined_shape import RefinedShape, on_built_face
from boxcal.target.tags.families import family_size, modules_per_side

FACES = 4
CORNERS = 4
MAX_TAGS_A_FACE = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """The dimensions of a box; the defaults are the default target.

    Frame ``box``: origin at the centre of the base, on the floor, z up. Faces 0, 1, 2, 3 have the outward
    normals +x, +y, -x, -y. Each carries ``rows x columns`` tags, centred; seen from outside with z up, columns
    count left to right and rows top to bottom.

    Attributes
    ----------
    width, depth, height : m
        Along x, y and z.
    columns, rows
        Tags across and down a face.
    tag_size : m
        Outer edge of a tag's black border.
    pitch : m
        From one tag's centre to the next, along both axes.
    first_id
        Id of face 0's top-left tag; ids then run on by columns, rows and faces.
    dictionary
        Tag family, by OpenCV's name.
    """

    width: float = 0.25
    depth: float = 0.25
    height: float = 0.20
    columns: int = 7
    rows: int = 5
    tag_size: float = 0.028
    pitch: float = 0.035
    first_id: int = 0
    dictionary: str = "DICT_APRILTAG_36h11"

    def __post_init__(self) -> None:
        for name in ("width", "depth", "height", "tag_size", "pitch"):
            value = getattr(self, name)
            if not (isfinite(value) and 0 < value < 100):
                raise TargetError(f"{name} is {value}: a length between 0 and 100 m is needed")
        if not (self.columns >= 1 and self.rows >= 1 and self.tags_a_face <= MAX_TAGS_A_FACE):
            raise TargetError(
                f"{self.columns} columns by {self.rows} rows: at least one of each and at most {MAX_TAGS_A_FACE} "
                "tags a face are needed"
            )
        gap, module = self.pitch - self.tag_size, self.tag_size / modules_per_side(self.dictionary)
        if gap < module * (1 - 1e-9) and self.tags_a_face > 1:
            raise TargetError(
                f"tags of {self.tag_size * 1e3:g} mm at a pitch of {self.pitch * 1e3:g} mm leave {gap * 1e3:.4g} mm "
                f"between them, a white border of one module ({module * 1e3:.4g} mm) is needed",
                remedy="enlarge pitch or reduce tag_size",
            )
        grid_w = (self.columns - 1) * self.pitch + self.tag_size
        grid_h = (self.rows - 1) * self.pitch + self.tag_size
        for grid, room, side, count in (
            (grid_w, min(self.width, self.depth), "width and depth", "columns"),
            (grid_h, self.height, "height", "rows"),
        ):
            if grid + 2 * module > room * (1 + 1e-9):
                raise TargetError(
                    f"the tags need {(grid + 2 * module) * 1e3:.4g} mm with their white border, the face has "
                    f"{room * 1e3:.4g} mm",
                    remedy=f"enlarge {side}, or reduce {count}, pitch or tag_size",
                )
        last, size = self.first_id + FACES * self.tags_a_face - 1, family_size(self.dictionary)
        if self.first_id < 0 or last >= size:
            raise TargetError(
                f"ids {self.first_id} to {last}: {self.dictionary} has ids 0 to {size - 1}",
                remedy="change first_id, columns, rows or dictionary",
            )

    @property
    def tags_a_face(self) -> int:
        """Number of tags on one face."""
        return self.columns * self.rows

    def T_box_face(self, face: int) -> Array:
        """Return the pose of a face, (4, 4), m.

        Frame ``face``: origin at the face's centre, x to the right and y up as seen from outside, z outward.
        """
        return _face_pose(face, width=self.width, depth=self.depth, centre_height=self.height / 2)

    def face_width(self, face: int) -> float:
        """Return the width of a face, m (depth for faces 0 and 2, width for 1 and 3)."""
        return self.depth if face % 2 == 0 else self.width

    def grid_corners(self) -> Array:
        """Return the tags' corners in the frame of their face.

        Returns
        -------
        (rows * columns, 4, 2), m: x right and y up from the face's centre; corners in the order top-left, top-right,
        bottom-right, bottom-left; tags by rows, then columns.
        """
        col, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        centre = np.stack([(col - (self.columns - 1) / 2) * self.pitch, ((self.rows - 1) / 2 - row) * self.pitch], -1)
        offsets = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * (self.tag_size / 2)
        return np.asarray(centre.reshape(-1, 1, 2) + offsets)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """A box with its landmark table: what a robot can see, and where it is.

    A landmark is one corner of one tag; its id is ``4 * tag id + corner``, corners in the order top-left, top-right,
    bottom-right, bottom-left as seen from outside with z up.

    Attributes
    ----------
    box
        The dimensions that the box was made from.
    tag_ids : (T,)
        Ascending.
    tag_corners : (T, 4, 3), m
        Corners in frame ``box``.
    tag_faces : (T,)
        The face that carries each tag.
    measured
        What the built box measures; its corners then follow that, not the design.
    refined
        What a fleet found of the built box besides; its corners then follow that too.
    """

    box: Box
    tag_ids: Ids
    tag_corners: Array
    tag_faces: Ids
    measured: Measured | None = None
    refined: RefinedShape | None = None
    _rows: dict[int, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_rows", {int(tag): row for row, tag in enumerate(self.tag_ids)})

    def __contains__(self, tag_id: int) -> bool:
        return int(tag_id) in self._rows

    def row_of(self, tag_id: int) -> int:
        """Return the row of a tag in the table (KeyError if the target does not carry it)."""
        return self._rows[int(tag_id)]

    def T_box_face(self, face: int) -> Array:
        """Return the pose of a face's print as it is described, (4, 4), m: designed, or measured if it was.

        Frame ``face`` as :meth:`Box.T_box_face` has it, at the centre of the print.
        """
        if self.measured is None:
            return self.box.T_box_face(face)
        size = self.measured
        return _face_pose(face, width=size.width, depth=size.depth, centre_height=size.sy * self.box.height / 2)

    @property
    def unrefined(self) -> "Target":
        """The target without what a fleet found of the built box."""
        return self if self.refined is None else make_target(self.box, self.measured)

    def p_box(self, landmark_ids: Ids) -> Array:
        """Return landmarks' positions, (N, 3) m in frame ``box``, for (N,) landmark ids."""
        rows = np.array([self._rows[int(i) // CORNERS] for i in landmark_ids], dtype=np.int64)
        return np.asarray(self.tag_corners[rows, np.asarray(landmark_ids) % CORNERS])

    def faces(self, landmark_ids: Ids) -> Ids:
        """Return the faces that carry landmarks, (N,), for (N,) landmark ids (KeyError for one it does not carry)."""
        return self.tag_faces[[self._rows[int(i) // CORNERS] for i in landmark_ids]]


def make_target(
    box: Box | None = None, measured: Measured | None = None, refined: RefinedShape | None = None
) -> Target:
    """Return the landmark table of a box as designed (the default box if none is given), as measured, or as refined.

    Raises
    ------
    TargetError
        If a measured dimension lies more than 5 % from the design.

    Examples
    --------
    >>> import boxcal
    >>> target = boxcal.make_target(boxcal.Box(width=0.12, depth=0.12, height=0.12, columns=3, rows=3))
    >>> len(target.tag_ids)
    36
    """
    box = box or Box()
    grid = box.grid_corners()
    if measured is not None:
        check_credible(box, measured)
        grid = grid * (measured.sx, measured.sy)
    count = FACES * box.tags_a_face
    target = Target(
        box=box,
        tag_ids=np.arange(box.first_id, box.first_id + count, dtype=np.int64),
        tag_corners=np.zeros((count, CORNERS, 3)),
        tag_faces=np.repeat(np.arange(FACES, dtype=np.int64), box.tags_a_face),
        measured=measured,
        refined=refined,
    )
    p_face = np.concatenate([grid, np.zeros((*grid.shape[:2], 1))], axis=2)
    corners = []
    for f in range(FACES):
        T = target.T_box_face(f)
        p = p_face if refined is None else on_built_face(refined, f, grid, box.face_width(f) / 2)
        corners.append(p @ T[:3, :3].T + T[:3, 3])
    return replace(target, tag_corners=np.concatenate(corners))


def _face_pose(face: int, *, width: float, depth: float, centre_height: float) -> Array:
    normals = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)
    n = normals[face % FACES]
    half = (width if face % 2 == 0 else depth) / 2
    T = np.eye(4)
    T[:3, 0] = (-n[1], n[0], 0)
    T[:3, 1] = (0, 0, 1)
    T[:3, 2] = (n[0], n[1], 0)
    T[:3, 3] = (half * n[0], half * n[1], centre_height)
    return T
