"""Target deformation: print scale, dot gain, pose and bow of each face.

Every sheet is a rigid face that lies where the description has it, moved by a small rigid motion (glued a little
aside, low or turned; a box that is not square), printed a little too large or small, and bowed. All landmarks of one
face in one image move with the camera's six degrees of freedom, so a face's pose costs no derivatives of its own.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import exp_so3, hat, right_jacobian
from boxcal.calib.likelihood.backend import backend
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, FACES
from boxcal.target.measure.refined_shape import FACE_AXES, SHAPE, RefinedShape

_OUTWARD = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""Where a tag's corners lie from its centre, x right and y up as seen from outside."""
DIRECT = 4
"""Unknowns with derivatives of their own in a corner's Jacobian: print scale x and y, dot gain, bow."""
HAND_MADE = {"print": 1.5e-3, "place": 3e-4, "turn": float(np.radians(0.15)), "bow": 3e-4}
"""Standard deviations of a box made by hand (relative, m, rad, m): printer 0.15 %, glued to 0.3 mm and 0.15 deg."""

DEFORMATIONS = frozenset({*SHAPE, "ink"})
"""Names of all unknowns of the target."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetDeformation:
    """The unknowns of the target as built, all zero for the target as described, and the landmarks that they move.

    Attributes
    ----------
    names : n
        ``scale_x, scale_y`` (relative), ``seat`` (m), ``ink`` (m), ``bow0`` ... ``bow3`` (m), ``face0_tx`` ...
        ``face3_rz`` (m, rad). The seat is how much higher all sheets stand: nobody knows whether a sheet that came out
        too small was glued by its middle or by its lower edge.
    sigma : (n,)
        Standard deviations of their priors where the data do not determine it.
    component : (n,)
        The variance component that each belongs to; empty where its prior is fixed.
    unit : (n,)
        Standard deviation of each over that of its component.
    information : (n, n)
        What was measured of the target besides.
    p_face : (L, 3), m
        Landmarks as described, in the frame of their face.
    face : (L,)
        Face of each landmark.
    outward : (L, 2)
        Signs of the corner's direction from its tag's centre, in its face.
    sagitta : (L,)
        Fraction of the bow at each landmark: 1 on the face's vertical midline, 0 at its edges.
    T_box_face : (FACES, 4, 4), m
        Poses of the faces as described.
    refined
        What is known of the shape before, where a fleet refined it: the unknowns are departures from it.
    by_direct : (L, 3, direct)
        Derivatives of the landmarks, in the frame of their face, by the direct unknowns.
    """

    names: tuple[str, ...]
    sigma: Array
    component: tuple[str, ...]
    unit: Array
    information: Array
    p_face: Array
    face: Ids
    outward: Array
    sagitta: Array
    T_box_face: Array
    refined: RefinedShape | None = None
    by_direct: Array = field(init=False)

    def __post_init__(self) -> None:
        """Set what follows from the rest."""
        d = np.zeros((len(self.p_face), 3, self.direct))
        if self.direct:
            d[:, 0, 0], d[:, 1, 1] = self.p_face[:, 0], self.p_face[:, 1]
            d[:, :2, 2], d[:, 2, 3] = self.outward, self.sagitta
        object.__setattr__(self, "by_direct", d)

    @property
    def direct(self) -> int:
        """Number of the target's own columns in a corner's Jacobian."""
        return DIRECT if self.names else 0

    def column(self, name: str) -> int | None:
        """Return where an unknown stands, None if it is not one."""
        return self.names.index(name) if name in self.names else None

    def value(self, values: Array, name: str) -> float:
        """Return the value of an unknown, 0 if it is none."""
        at = self.column(name)
        return 0.0 if at is None else float(values[at])

    def shape(self, values: Array, name: str) -> float:
        """Return the departure from the description, of which an unknown of :data:`SHAPE` is the unknown part."""
        return self.value(values, name) + (0.0 if self.refined is None else self.refined.value(name))

    def motions(self, values: Array) -> tuple[Array, Array, Array]:
        """Return the faces' motions in their own frames: R (FACES, 3, 3), t (FACES, 3), and J (FACES, 6, 6).

        J gives the twist (rotation, translation at the frame's origin) of the moved face by its six unknowns.
        """
        R, t, J = np.tile(np.eye(3), (FACES, 1, 1)), np.zeros((FACES, 3)), np.zeros((FACES, 6, 6))
        t[:, 1] = self.shape(values, "seat")
        J[:, 3:, :3] = np.eye(3)
        first = self.column("face0_tx")
        if first is not None or self.refined is not None:
            pose = np.zeros((FACES, 6)) if first is None else values[first : first + 6 * FACES].reshape(FACES, 6)
            pose = pose if self.refined is None else pose + self.refined.values[-6 * FACES :].reshape(FACES, 6)
            t += pose[:, :3]
            R = exp_so3(pose[:, 3:])
            J[:, :3, 3:] = left = R @ right_jacobian(pose[:, 3:])
            J[:, 3:, 3:] = hat(t) @ left
        return R, t, J

    def landmarks(self, values: Array) -> tuple[Array, Array]:
        """Return the landmarks (L, 3), m, in frame ``box``, and the rotations of their faces (FACES, 3, 3).

        A landmark p of its face becomes ``T_box_face exp(w, t) (p + scale * p + ink * outward + bow * sagitta)``; how
        it moves with the direct unknowns, in the frame of its face, is ``by_direct``.
        """
        p = self.p_face.copy()
        T = self.T_box_face
        if not (self.names or self.refined):
            return backend().moved_points(T[:, :3, :3], T[:, :3, 3], self.face, p), T[:, :3, :3]
        p[:, 0] *= 1 + self.shape(values, "scale_x")
        p[:, 1] *= 1 + self.shape(values, "scale_y")
        p[:, :2] += self.value(values, "ink") * self.outward
        bow = np.array([self.shape(values, f"bow{f}") for f in range(FACES)])
        p[:, 2] += bow[self.face] * self.sagitta
        R_m, t_m, _ = self.motions(values)
        R = T[:, :3, :3] @ R_m
        t = np.einsum("fij,fj->fi", T[:, :3, :3], t_m) + T[:, :3, 3]
        return backend().moved_points(R, t, self.face, p), R


def target_deformation(
    options: EstimateOptions, landmark_ids: Ids, p_box: Array, faces: Ids | None = None
) -> TargetDeformation:
    """Return the unknowns of the target that the options ask for.

    Parameters
    ----------
    options
        Priors, and the target's description.
    landmark_ids : (L,)
    p_box : (L, 3), m
    faces : (L,)
        Face of each landmark; needed only where there is no description.

    Raises
    ------
    CalibError
        If a landmark is not of the target that the options describe.
    """
    L = len(landmark_ids)
    target = options.target
    if target is None:
        flat = np.zeros(L, dtype=np.int64) if faces is None else faces
        return TargetDeformation(
            names=(),
            sigma=np.zeros(0),
            component=(),
            unit=np.zeros(0),
            information=np.zeros((0, 0)),
            p_face=p_box,
            face=flat,
            outward=_OUTWARD[landmark_ids % CORNERS],
            sagitta=np.zeros(L),
            T_box_face=np.tile(np.eye(4), (FACES, 1, 1)),
        )
    tags, back = np.unique(landmark_ids // CORNERS, return_inverse=True)
    unknown = [int(tag) for tag in tags if int(tag) not in target]
    if unknown:
        raise CalibError(
            f"landmarks of tag {unknown[0]}, which the box' description does not carry",
            remedy="give the target.json that the landmarks were found with",
        )
    rows = np.array([target.row_of(int(t)) for t in tags], dtype=np.int64)[back]
    face = target.tag_faces[rows]
    off = np.linalg.norm(target.tag_corners[rows, landmark_ids % CORNERS] - p_box, axis=1)
    if off.size and off.max() > 1e-6:
        raise CalibError(
            f"a landmark lies {off.max() * 1e3:.3g} mm from where the box' description has it",
            remedy="give the target.json that the landmarks were found with",
        )
    T = np.array([target.T_box_face(f) for f in range(FACES)])
    described = target.unrefined.tag_corners[rows, landmark_ids % CORNERS] if target.refined else p_box
    p_face = np.einsum("lji,lj->li", T[face, :3, :3], described - T[face, :3, 3])
    half = np.array([target.box.face_width(f) / 2 for f in range(FACES)])
    names, sigma, component, unit = _unknowns(options)
    return TargetDeformation(
        names=names,
        sigma=sigma,
        component=component,
        unit=unit,
        information=_measured(options, names),
        p_face=p_face,
        face=face,
        outward=_OUTWARD[landmark_ids % CORNERS],
        sagitta=1 - (p_face[:, 0] / half[face]) ** 2,
        T_box_face=T,
        refined=target.refined,
    )


def _unknowns(options: EstimateOptions) -> tuple[tuple[str, ...], Array, tuple[str, ...], Array]:
    """Return names, prior standard deviations, variance components and units in these of the target's unknowns."""
    found: list[tuple[str, float, str, float]] = []

    def add(names: Iterable[str], given: float | None, component: str, unit: float = 1.0) -> None:
        sigma = HAND_MADE[component] if given is None else given
        if sigma > 0:
            found.extend((name, unit * sigma, component if given is None else "", unit) for name in names)

    target = options.target
    half = 0.0 if target is None else target.box.height / 2
    refined = _refined(options)
    if refined is not None:  # what the fleet found, with its covariance, is all that is known
        found += [(name, np.inf, "", 1.0) for name in _refined_by(refined)]
        found += [("ink", options.ink_sigma, "", 1.0)] if options.ink_sigma > 0 else []
        return _columns(found)
    measured = target.measured if target is not None and options.measured_sizes else None
    if measured is not None and options.scale_sigma is None:  # the ruler says all that is known of the print
        found += [("scale_x", np.inf, "", 1.0), ("scale_y", np.inf, "", 1.0)]
        add(("seat",), float(np.sqrt(measured.cov[1, 1])), "print", half)
    else:
        add(("scale_x", "scale_y"), options.scale_sigma, "print")
        add(("seat",), options.scale_sigma, "print", half)
    if options.ink_sigma > 0:
        found.append(("ink", options.ink_sigma, "", 1.0))
    add((f"bow{f}" for f in range(FACES)), options.bow_sigma, "bow")
    turn, place = (None, None) if options.face_sigma is None else options.face_sigma
    for f in range(FACES):
        add((f"face{f}_{axis}" for axis in FACE_AXES[:3]), place, "place")
        add((f"face{f}_{axis}" for axis in FACE_AXES[3:]), turn, "turn")
    return _columns(found)


def _columns(found: list[tuple[str, float, str, float]]) -> tuple[tuple[str, ...], Array, tuple[str, ...], Array]:
    """Return unknowns, each with its prior's sigma, component and unit, column by column."""
    if not found:
        return (), np.zeros(0), (), np.zeros(0)
    names, sigma, component, unit = zip(*found, strict=True)
    return tuple(names), np.array(sigma), tuple(component), np.array(unit)


def _refined(options: EstimateOptions) -> RefinedShape | None:
    """Return what a fleet found of the box, where no option asks for other priors."""
    asked = (options.scale_sigma, options.face_sigma, options.bow_sigma)
    if options.target is None or any(sigma is not None for sigma in asked):
        return None
    return options.target.refined


def _refined_by(refined: RefinedShape) -> tuple[str, ...]:
    """Return the unknowns of the shape that a fleet solved for."""
    return tuple(name for name in SHAPE if refined.sigma(name) > 0)


def _measured(options: EstimateOptions, names: tuple[str, ...]) -> Array:
    """Return the information on the unknowns that a fleet or a ruler gave (print scales, width and depth)."""
    out = np.zeros((len(names), len(names)))
    refined = _refined(options)
    if refined is not None:
        refining = _refined_by(refined)
        rows, columns = [SHAPE.index(name) for name in refining], [names.index(name) for name in refining]
        out[np.ix_(columns, columns)] = _inverse(refined.cov[np.ix_(rows, rows)])
        return out
    at = {name: k for k, name in enumerate(names)}
    cov = np.diag(np.square([np.inf, np.inf, options.size_sigma or np.inf, options.size_sigma or np.inf]))
    measured = options.target.measured if options.target is not None and options.measured_sizes else None
    if measured is not None:
        cov = measured.cov[:4, :4] + np.where(np.isfinite(cov), cov, 0.0)
    J = np.zeros((4, len(names)))
    for row, unknowns in enumerate((("scale_x",), ("scale_y",), ("face0_tz", "face2_tz"), ("face1_tz", "face3_tz"))):
        for name in unknowns:
            if name in at:
                J[row, at[name]] = 1.0
    known = np.isfinite(np.diag(cov)) & np.any(J != 0, axis=1)
    if np.any(known):
        C = cov[np.ix_(known, known)]
        C = C + _JITTER * np.diag(np.diag(C))
        out = J[known].T @ np.linalg.solve(C, J[known])
    return out


def _inverse(cov: Array) -> Array:
    """Return the inverse of a covariance whose standard deviations may differ by orders of magnitude."""
    sigma = np.sqrt(np.diag(cov))
    unit = np.linalg.inv(cov / np.outer(sigma, sigma)) / np.outer(sigma, sigma)
    return np.asarray((unit + unit.T) / 2)


_JITTER = 1e-9
"""Relative; sizes measured with one ruler may have a covariance that cannot be inverted."""
