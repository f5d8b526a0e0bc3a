"""One thing that is not as the model has it, and how each kind is drawn at random."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, radians

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.simulate.imperfections import Imperfections
from boxcal.calib.simulate.robot import Robot
from boxcal.target.box import FACES

Draw = Callable[[Imperfections, float, Robot, np.random.Generator], Imperfections]


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """One thing that is not as the model has it.

    Attributes
    ----------
    name
        In words.
    causes
        Beginnings of the causes that a diagnosis may give; none where the model as it stands takes it in.
    sizes
        Sizes to try.
    unit
        Of the sizes.
    draw
        Adds it to imperfections that are there already: (those, size, robot, generator).
    scale
        What a size is multiplied by to be the size that a diagnosis gives; 0 where it gives none.
    usual
        Standard deviation of what a hand-made box has of the same, besides.
    """

    name: str
    causes: tuple[str, ...]
    sizes: tuple[float, ...]
    unit: str
    draw: Draw
    scale: float = 1.0
    usual: float = 0.0


STOPS = 14
"""Stops of the drives that faults at a stop or leg are drawn for."""


def with_wheels(before: Imperfections, **changes: object) -> Imperfections:
    """Return imperfections with some of the wheels' changed."""
    return replace(before, wheels=replace(before.wheels, **changes))  # type: ignore[arg-type]


def with_camera(before: Imperfections, **changes: object) -> Imperfections:
    """Return imperfections with some of the camera's changed."""
    return replace(before, camera=replace(before.camera, **changes))  # type: ignore[arg-type]


def with_box(before: Imperfections, **changes: object) -> Imperfections:
    """Return imperfections with some of the box's changed."""
    return replace(before, box=replace(before.box, **changes))  # type: ignore[arg-type]


def eccentric_wheels(before: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    """Return imperfections in which both wheels are out of round by ``size`` %, at random phases."""
    a, b = rng.uniform(0, 2 * pi, 2)
    e = size / 100
    return with_wheels(before, eccentric=(e * np.cos(a), e * np.sin(a), e * np.cos(b), e * np.sin(b)))


def scrubbing_turns(before: Imperfections, size: float, robot: Robot, rng: np.random.Generator) -> Imperfections:
    """Return imperfections in which ``size`` % of turns are lost, to one side more, and the robot slides sideways."""
    e = size / 100
    sides = (1.25 * e, 0.75 * e) if rng.integers(2) else (0.75 * e, 1.25 * e)
    return with_wheels(before, scrub=(*sides, 0.0), drift=e * robot.b / 2)


def slipped_leg(before: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    """Return imperfections in which one wheel slips by ``size`` mm on one leg."""
    wheel = (size * 1e-3, 0.0) if rng.integers(2) else (0.0, size * 1e-3)
    return with_wheels(before, slipped=(int(rng.integers(STOPS - 1)), *wheel))


def carried_robot(before: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    """Return imperfections in which the robot is carried by ``size`` mm, and turned, on one leg."""
    a, turn = rng.uniform(0, 2 * pi), rng.uniform(10, 40) * rng.choice([-1, 1])
    move = (size * 1e-3 * np.cos(a), size * 1e-3 * np.sin(a), radians(turn))
    return with_wheels(before, carried=(int(rng.integers(STOPS - 1)), *move))


def moved_box(before: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    """Return imperfections in which the box is pushed by ``size`` mm before one stop."""
    a = rng.uniform(0, 2 * pi)
    move = (size * 1e-3 * np.cos(a), size * 1e-3 * np.sin(a), radians(rng.uniform(-1, 1)))
    return with_box(before, moved=(int(rng.integers(2, STOPS - 1)), *move))


def knocked_camera(before: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    """Return imperfections in which the camera is turned by ``size`` deg about some axis before one stop."""
    axis = rng.standard_normal(3)
    w = radians(size) * axis / np.linalg.norm(axis)
    return with_camera(before, knocked=(int(rng.integers(4, STOPS - 3)), (*w.tolist(), 0.0, 0.0, 0.0)))


def ordered(*order: int) -> Draw:
    """Return what puts the sheets on the faces in another order."""
    return lambda before, _s, _r, _g: with_box(before, order=order)


def box_standing(w: tuple[float, float, float], t: tuple[float, float, float]) -> Draw:
    """Return what stands the box otherwise: rotation vector (rad) and translation (m)."""
    return lambda before, _s, _r, _g: with_box(before, standing=rigid(exp_so3(np.array(w)), np.array(t)))


def counts(right: float, left: float) -> Draw:
    """Return what multiplies the wheels' readings."""
    return lambda before, _s, _r, _g: with_wheels(before, counts=(right, left))


def low_sheet(before: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    """Return imperfections in which one sheet but the first is glued ``size`` mm too low."""
    place = np.zeros((FACES, 3)) if before.box.place is None else before.box.place.copy()
    place[rng.integers(1, FACES), 1] -= size * 1e-3
    return with_box(before, place=place)
