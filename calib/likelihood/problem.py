"""The unknowns and the data of the likelihood.

Unknowns that all stops share ("shared") come first: the fourteen that are reported, the floor's tilt a drive, further
coefficients of the camera model, the target as built, explanations. Every stop adds five that legs couple with the next
stop's (the chain): its pose on the floor ``(x, y, theta)`` and the two errors of its wheel readings; and four of its
own (local): roll, pitch, height and the growth of the tags' black in its image.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from boxcal.calib.geometry.diff_drive import Legs, legs_between
from boxcal.calib.geometry.parameters import COUNT, ORDER
from boxcal.calib.geometry.two_by_two import determinants, inverse_roots
from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.seen_views import Views, outward_px
from boxcal.calib.likelihood.target_deformation import TargetDeformation, target_deformation
from boxcal.calib.likelihood.wheel_path import WheelPath, wheel_path
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array, Ids, Mask
from boxcal.target.camera.camera_model import CameraKind, further_names

PER_STOP = 5
"""Unknowns of a stop in the chain."""
LOCAL = 4
"""Unknowns of a stop that no leg touches."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """The data of one robot's drives, stops and legs numbered through.

    Attributes
    ----------
    lens
        Camera model.
    names
        Of the shared unknowns.
    prior : (n,)
        Standard deviations of their priors (zero mean), infinite where there is none; of those that belong to a
        variance component what holds where the data do not determine it.
    component : (n,)
        Variance component of each shared unknown, empty where its prior is fixed.
    unit : (n,)
        Standard deviation of each over that of its component.
    information : (n, n)
        What was measured of them besides.
    target
        Landmarks and their unknowns.
    uv_px : (L, 2)
        Corners seen.
    whiten : (L, 2, 2), 1/px
        Turns a corner's error into unit variance, before the noise scale.
    stated_px2 : (L, 2, 2), px^2
        The corners' covariances as they were stated.
    floor_px : px
        What is added to them: see :mod:`boxcal.calib.likelihood.corner_floor`.
    sigma_px : px
        Standard deviation of a corner's coordinate before the noise scale, over all corners.
    corner_starts : (P + 1,)
        First corner of each stop.
    outward_px : (L, 2)
        How corners move where all edges of the tags' black move outwards by 1 px.
    path
        Wheel travel.
    step : rad
        Encoder step.
    drives
        How many drives there are.
    drive : (P,)
        The drive of each stop.
    stop : (P,)
        Its number within the drive's correspondences.
    leg_stop : (N,)
        First stop of each leg; its second is the next.
    leg_known : (N,) bool
        Whether the wheels' travel is known all along the leg.
    tilt_count
        How many tilt angles are unknown.
    rigid_floor
        Whether stops neither lean nor sink.
    explanations
        What else is part of the model.
    of_component
        The shared unknowns of each variance component.
    tilts, extras, shapes, growth, explained
        Columns among the shared unknowns: of the tilts, the further distortion coefficients, the target's deformation,
        the tags' growth in px that is common to all images, and the explanations.
    """

    lens: CameraKind
    names: tuple[str, ...]
    prior: Array
    component: tuple[str, ...]
    unit: Array
    information: Array
    target: TargetDeformation
    uv_px: Array
    whiten: Array
    stated_px2: Array
    floor_px: float = 0.0
    sigma_px: float
    corner_starts: Ids
    outward_px: Array
    path: WheelPath
    step: float
    drives: int
    drive: Ids
    stop: Ids
    leg_stop: Ids
    leg_known: Mask
    tilt_count: int
    rigid_floor: bool
    explanations: tuple[Explanation, ...]
    of_component: dict[str, Ids] = field(init=False)
    tilts: slice = field(init=False)
    extras: slice = field(init=False)
    shapes: slice = field(init=False)
    growth: slice = field(init=False)
    explained: slice = field(init=False)

    def __post_init__(self) -> None:
        """Set what follows from the rest; it is asked for hundreds of times."""
        put = partial(object.__setattr__, self)
        names = np.array(self.component)
        put("of_component", {name: np.flatnonzero(names == name) for name in sorted(set(self.component) - {""})})
        first = COUNT
        for name, count in (
            ("tilts", self.tilt_count),
            ("extras", len(further_names(self.lens))),
            ("shapes", len(self.target.names)),
            ("growth", int("growth" in self.names)),
        ):
            put(name, slice(first, first + count))
            first += count
        put("explained", slice(first, len(self.names)))

    @property
    def corner_stop(self) -> Ids:
        """The stop of each corner, (L,)."""
        return np.repeat(np.arange(len(self.drive)), np.diff(self.corner_starts))


def build_problem(
    drives: Sequence[Correspondences], kept: Sequence[tuple[int, ...]], options: EstimateOptions, step: float
) -> Problem:
    """Return the data of some stops of some drives, one behind the other.

    Parameters
    ----------
    drives
        What was seen and rolled.
    kept
        Numbers of the stops to use, for each drive (none is allowed); the robot drives through the others.
    options
        Which unknowns there are.
    step : rad
        Encoder step.
    """
    views = Views.of([drive.stops[j] for drive, stops in zip(drives, kept, strict=True) for j in stops])
    drive = np.repeat(np.arange(len(drives)), [len(stops) for stops in kept])
    stop = np.concatenate([np.asarray(stops, dtype=np.int64) for stops in kept])
    legs = [legs_between(d, k) for d, k in zip(drives, kept, strict=True) if k]
    return problem_of(views, (drive, stop), legs, options, step)


def problem_of(
    views: Views, places: tuple[Ids, Ids], legs: list[Legs], options: EstimateOptions, step: float
) -> Problem:
    """Return the data of some views at stops, and of the legs between them.

    Parameters
    ----------
    views
        What was seen.
    places : (P,), (P,)
        Drive and number of each view's stop.
    legs
        Wheel travel of each drive that has stops.
    options, step
        As of :func:`build_problem`.
    """
    kind, cov = options.lens or CameraKind.BROWN, views.cov_px2
    drive, stop = places
    drives = int(drive.max(initial=0)) + 1
    tilts = _tilt_names(drives) if options.tilt_sigma > 0 else []
    names = [*ORDER, *tilts]
    prior, component = [np.inf] * COUNT + [options.tilt_sigma] * len(tilts), [""] * COUNT
    names += further_names(kind)
    prior += [np.inf] * len(further_names(kind))
    target = target_deformation(options, views.landmark_ids, views.p_box, views.faces)
    component += [""] * (len(names) - COUNT) + list(target.component)
    first = len(names)
    names += target.names
    prior += target.sigma.tolist()
    if target.names and options.growth_sigma > 0:
        names.append("growth")
        prior.append(options.growth_sigma)
        component.append("")
    for explanation in options.explanations:
        names += explanation.names
        prior += explanation.prior
        component += [""] * len(explanation.names)
    information = np.zeros((len(names), len(names)))
    information[first : first + len(target.names), first : first + len(target.names)] = target.information
    whiten, sigma_px = whitening(cov)
    return Problem(
        lens=kind,
        names=tuple(names),
        prior=np.array(prior),
        component=tuple(component),
        unit=np.concatenate([np.ones(first), target.unit, np.ones(len(names) - first - len(target.names))]),
        information=information,
        target=target,
        uv_px=views.uv_px,
        whiten=whiten,
        stated_px2=cov,
        sigma_px=sigma_px,
        corner_starts=views.starts,
        outward_px=outward_px(views),
        path=wheel_path(legs),
        step=step,
        drives=drives,
        drive=drive,
        stop=stop,
        leg_stop=np.flatnonzero(drive[:-1] == drive[1:]),
        leg_known=np.concatenate([np.zeros(0, dtype=np.bool_), *(leg.known for leg in legs)]),
        tilt_count=len(tilts),
        rigid_floor=options.rigid_floor,
        explanations=options.explanations,
    )


def whitening(cov_px2: Array) -> tuple[Array, float]:
    """Return what whitens errors of covariances (L, 2, 2), (L, 2, 2), and a standard deviation typical of them, px."""
    whiten = inverse_roots(cov_px2)
    return whiten, float(1 / np.sqrt(np.mean(determinants(whiten))))


def _tilt_names(drives: int) -> list[str]:
    """Return the names of the floor's tilts, two for each drive."""
    suffixes = [""] if drives == 1 else [f"_{d + 1}" for d in range(drives)]
    return [f"tilt_{axis}{suffix}" for suffix in suffixes for axis in "xy"]


def with_kind(problem: Problem, kind: CameraKind) -> Problem:
    """Return the same problem with another camera model."""
    at, old = problem.extras, problem.lens
    new = further_names(kind)
    if kind is old:
        return problem

    def swapped(values: Array, fill: float, axis: int) -> Array:
        without = np.delete(values, np.arange(at.start, at.stop), axis=axis)
        return np.insert(without, [at.start] * len(new), fill, axis=axis)

    return replace(
        problem,
        lens=kind,
        names=(*problem.names[: at.start], *new, *problem.names[at.stop :]),
        prior=swapped(problem.prior, np.inf, 0),
        component=(*problem.component[: at.start], *("",) * len(new), *problem.component[at.stop :]),
        unit=swapped(problem.unit, 1.0, 0),
        information=swapped(swapped(problem.information, 0.0, 0), 0.0, 1),
    )
