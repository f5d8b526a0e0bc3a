"""The unknowns of a robot with several cameras, and the data of each camera among them.

The chain of stops, the wheels, the floor and the box are those of one problem, whose camera is the first; the other
cameras' own unknowns stand behind it, where explanations stand in a problem of one camera. Every stop's local unknowns
are roll, pitch and height of the body, and the growth of the tags' black in each camera's image.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.parameters import CAMERA, MOUNTING, ORDER
from boxcal.calib.likelihood.cameras.row import Row
from boxcal.calib.likelihood.explanation import Explanation
from boxcal.calib.likelihood.options import EstimateOptions
from boxcal.calib.likelihood.problem import Problem, build_problem
from boxcal.target.arrays import Array, Ids
from boxcal.target.camera.camera_model import further_names

BODY = 3
"""Local unknowns of a stop that all cameras share: roll, pitch and height."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """One camera's data.

    Attributes
    ----------
    problem
        As of a robot with this camera alone, without explanations.
    corners : (L,)
        Weights of its corners.
    places : (P_c,)
        Where its stops stand among all.
    columns : (n_c,)
        Where its problem's shared unknowns stand among all.
    course : (P_c, 3, 2), optional
        How the wheels turn at its stops and frames on the move (:mod:`boxcal.calib.likelihood.moving.course`); None
        where it has no such frames.
    within : m/sqrt(m)
        Slip while a frame is read, over the noise scale of its corners.
    height : px
        Of its images.
    readout
        Place of its readout time among the causes, which is then the last unknown of its problem.
    """

    problem: Problem
    corners: Array
    places: Ids
    columns: Ids
    course: Array | None = None
    within: float = 0.0
    height: int = 0
    readout: int = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Together:
    """One robot with several cameras.

    Attributes
    ----------
    problem
        All unknowns, legs and priors; its corners stand in only.
    parts
        The cameras' data.
    causes
        How many unknowns the explanations of what the wheels do have; those of the other cameras follow.
    """

    problem: Problem
    parts: tuple[Part, ...]
    causes: int

    @property
    def others(self) -> int:
        """Unknowns of the cameras after the first."""
        return len(self.problem.names) - int(self.problem.explained.start) - self.causes


def bare(problem: Problem) -> Problem:
    """Return a problem without its explanations."""
    n = problem.explained.start
    return replace(
        problem,
        names=problem.names[:n],
        prior=problem.prior[:n],
        component=problem.component[:n],
        unit=problem.unit[:n],
        information=problem.information[:n, :n],
        explanations=(),
    )


def together(
    problems: Sequence[Problem],
    corners: Sequence[Array],
    row: Row,
    options: EstimateOptions,
    explanations: tuple[Explanation, ...] = (),
) -> Together:
    """Return a robot with several cameras.

    Parameters
    ----------
    problems, corners
        Of each camera alone, and its corners' weights (L,).
    row
        The stops of all.
    options
        Those of the first camera.
    explanations
        Of what the wheels do.
    """
    options = replace(options, lens=problems[0].lens, explanations=explanations)
    kept = [tuple(range(len(drive.stops))) for drive in row.drives]
    chain = build_problem(row.drives, kept, options, max(p.step for p in problems))
    causes = len(chain.names) - chain.explained.start
    first = problems[0]
    for number, other in enumerate(problems[1:], 2):
        chain = _with_camera(chain, bare(other), number)
    parts = [
        Part(problem=own, corners=weights, places=places, columns=_columns(chain, own, number))
        for number, (own, weights, places) in enumerate(
            zip((bare(first), *map(bare, problems[1:])), corners, row.places, strict=True), 1
        )
    ]
    return Together(problem=chain, parts=tuple(parts), causes=causes)


def own_name(name: str, number: int) -> str:
    """Return what an unknown of a camera's own, numbered from 1, is called among all."""
    return name if number == 1 else f"camera{number}-{name}"


def own_names(problem: Problem) -> tuple[str, ...]:
    """Return the names of a camera's own unknowns: lens, extrinsics, and growth where that is unknown."""
    growth = problem.names[problem.growth]
    return (*ORDER[CAMERA], *ORDER[MOUNTING], *further_names(problem.lens), *growth)


def _with_camera(chain: Problem, other: Problem, number: int) -> Problem:
    """Return the problem with the unknowns of one more camera at the end."""
    names = own_names(other)
    at = [other.names.index(name) for name in names]
    n = len(chain.names)
    information = np.zeros((n + len(names), n + len(names)))
    information[:n, :n] = chain.information
    return replace(
        chain,
        names=(*chain.names, *(own_name(name, number) for name in names)),
        prior=np.concatenate([chain.prior, other.prior[at]]),
        component=(*chain.component, *("",) * len(names)),
        unit=np.concatenate([chain.unit, np.ones(len(names))]),
        information=information,
    )


def _columns(chain: Problem, own: Problem, number: int) -> Ids:
    mine = set(own_names(own))
    return np.array([chain.names.index(own_name(n, number) if n in mine else n) for n in own.names], dtype=np.int64)
