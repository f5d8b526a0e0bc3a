"""A catalogue of what goes wrong with robots, boxes and floors, each in one or more sizes, to be drawn at random."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, radians

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.simulate.imperfections import Imperfections
from boxcal.calib.simulate.robot import Robot
from boxcal.target.box import FACES, Box

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


def _wheels(f: Imperfections, **changes: object) -> Imperfections:
    return replace(f, wheels=replace(f.wheels, **changes))  # type: ignore[arg-type]


def _camera(f: Imperfections, **changes: object) -> Imperfections:
    return replace(f, camera=replace(f.camera, **changes))  # type: ignore[arg-type]


def _box(f: Imperfections, **changes: object) -> Imperfections:
    return replace(f, box=replace(f.box, **changes))  # type: ignore[arg-type]


def _eccentric(f: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    """Both wheels out of round, phases at random."""
    a, b = rng.uniform(0, 2 * pi, 2)
    e = size / 100
    return _wheels(f, eccentric=(e * np.cos(a), e * np.sin(a), e * np.cos(b), e * np.sin(b)))


def _scrub(f: Imperfections, size: float, robot: Robot, rng: np.random.Generator) -> Imperfections:
    """Lose a share of each turn, to one side more, and slide aside by a share of half the width."""
    e = size / 100
    sides = (1.25 * e, 0.75 * e) if rng.integers(2) else (0.75 * e, 1.25 * e)
    return _wheels(f, scrub=(*sides, 0.0), drift=e * robot.b / 2)


def _slipped(f: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    wheel = (size * 1e-3, 0.0) if rng.integers(2) else (0.0, size * 1e-3)
    return _wheels(f, slipped=(int(rng.integers(STOPS - 1)), *wheel))


def _carried(f: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    a, turn = rng.uniform(0, 2 * pi), rng.uniform(10, 40) * rng.choice([-1, 1])
    move = (size * 1e-3 * np.cos(a), size * 1e-3 * np.sin(a), radians(turn))
    return _wheels(f, carried=(int(rng.integers(STOPS - 1)), *move))


def _moved(f: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    a = rng.uniform(0, 2 * pi)
    move = (size * 1e-3 * np.cos(a), size * 1e-3 * np.sin(a), radians(rng.uniform(-1, 1)))
    return _box(f, moved=(int(rng.integers(2, STOPS - 1)), *move))


def _knocked(f: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    axis = rng.standard_normal(3)
    w = radians(size) * axis / np.linalg.norm(axis)
    return _camera(f, knocked=(int(rng.integers(4, STOPS - 3)), (*w.tolist(), 0.0, 0.0, 0.0)))


def _order(*order: int) -> Draw:
    return lambda f, _s, _r, _g: _box(f, order=order)


def _standing(w: tuple[float, float, float], t: tuple[float, float, float]) -> Draw:
    return lambda f, _s, _r, _g: _box(f, standing=rigid(exp_so3(np.array(w)), np.array(t)))


def _counts(right: float, left: float) -> Draw:
    return lambda f, _s, _r, _g: _wheels(f, counts=(right, left))


def _face(f: Imperfections, size: float, _: Robot, rng: np.random.Generator) -> Imperfections:
    place = np.zeros((FACES, 3)) if f.box.place is None else f.box.place.copy()
    place[rng.integers(1, FACES), 1] -= size * 1e-3
    return _box(f, place=place)


_SIDE = 0.125
"""Half the default box' width, m: lying on its side, its middle is that high; its own height is 0.2 m."""

VIOLATIONS: tuple[Violation, ...] = (
    Violation(name="wheels out of round", causes=("eccentric",), sizes=(0.3, 1.0), unit="%", draw=_eccentric),
    Violation(
        name="radius backward",
        causes=("backward",),
        sizes=(0.3, 1.0),
        unit="%",
        draw=lambda f, s, _r, _g: _wheels(f, backward=s / 100),
    ),
    Violation(
        name="outer wheel in bends",
        causes=("outer",),
        sizes=(0.3, 1.0),
        unit="%",
        draw=lambda f, s, _r, _g: _wheels(f, outer=s / 100),
    ),
    Violation(
        name="backlash",
        causes=("backlash",),
        sizes=(0.5, 1.0, 2.0),
        unit="deg",
        draw=lambda f, s, _r, _g: _wheels(f, backlash=radians(s)),
    ),
    Violation(name="turns scrub", causes=("scrub",), sizes=(0.5, 1.2), unit="%", draw=_scrub, scale=0.0),
    Violation(
        name="scrub on the spot",
        causes=("scrub",),
        sizes=(1.0, 2.0),
        unit="%",
        draw=lambda f, s, _r, _g: _wheels(f, scrub=(0.0, 0.0, s / 100)),
    ),
    Violation(name="one leg slips", causes=("leg-",), sizes=(3.0, 10.0), unit="mm", draw=_slipped),
    Violation(
        name="robot carried",
        causes=("robot-carried", "leg-slipped", "box-moved"),
        sizes=(30.0, 150.0),
        unit="mm",
        draw=_carried,
        scale=0.0,
    ),
    Violation(name="box moved", causes=("box-moved",), sizes=(3.0, 6.0), unit="mm", draw=_moved),
    Violation(name="camera knocked", causes=("camera-knocked",), sizes=(0.1, 0.5), unit="deg", draw=_knocked),
    Violation(
        name="focus changed",
        causes=("focus",),
        sizes=(0.2, 1.0),
        unit="%",
        draw=lambda f, s, _r, g: _camera(f, focus=(int(g.integers(3, STOPS - 3)), 1 + s / 100, 0.0, 0.0)),
    ),
    Violation(
        name="crop changed",
        causes=("focus",),
        sizes=(2.0, 8.0),
        unit="px",
        draw=lambda f, s, _r, g: _camera(f, focus=(int(g.integers(3, STOPS - 3)), 1.0, s, 0.0)),
        scale=0.0,
    ),
    Violation(
        name="autofocus",
        causes=("focus",),
        sizes=(0.2,),
        unit="%",
        draw=lambda f, s, _r, _g: _camera(f, autofocus=s / 100),
    ),
    Violation(
        name="camera clock late",
        causes=("clock",),
        sizes=(1.5, 37.0),
        unit="s",
        draw=lambda f, s, _r, _g: _camera(f, late=s),
    ),
    Violation(
        name="camera clock drifts",
        causes=("clock",),
        sizes=(0.05,),
        unit="s/s",
        draw=lambda f, s, _r, _g: _camera(f, drift=s),
    ),
    Violation(
        name="encoders restart",
        causes=("encoder-restart", "leg-"),
        sizes=(3.0,),
        unit="rad",
        draw=lambda f, s, _r, g: _wheels(f, restart=(int(g.integers(STOPS - 1)), s)),
        scale=0.0,
    ),
    Violation(
        name="right counts double", causes=("counts",), sizes=(2.0,), unit="times", draw=_counts(2.0, 1.0), scale=0.0
    ),
    Violation(name="degrees", causes=("unit",), sizes=(57.3,), unit="", draw=_counts(180 / pi, 180 / pi), scale=0.0),
    Violation(
        name="ticks",
        causes=("unit",),
        sizes=(1,),
        unit="",
        draw=_counts(180 / pi / 0.1302, 180 / pi / 0.1302),
        scale=0.0,
    ),
    Violation(name="motor turns", causes=("unit",), sizes=(30.0,), unit="times", draw=_counts(30.0, 30.0), scale=0.0),
    Violation(
        name="metres",
        causes=("unit",),
        sizes=(1.0,),
        unit="",
        draw=lambda f, _s, r, _g: _wheels(f, counts=(r.rR, r.rL)),
        scale=0.0,
    ),
    Violation(
        name="wheels swapped", causes=("wheels-swapped",), sizes=(0,), unit="", draw=_counts(-1.0, -1.0), scale=0.0
    ),
    Violation(
        name="left reversed", causes=("wheel-reversed",), sizes=(0,), unit="", draw=_counts(1.0, -1.0), scale=0.0
    ),
    Violation(name="sheets 0, 1 swapped", causes=("sheets",), sizes=(0,), unit="", draw=_order(1, 0, 2, 3), scale=0.0),
    Violation(name="sheets 0, 2 swapped", causes=("sheets",), sizes=(0,), unit="", draw=_order(2, 1, 0, 3), scale=0.0),
    Violation(name="sheets reversed", causes=("sheets",), sizes=(0,), unit="", draw=_order(0, 3, 2, 1), scale=0.0),
    Violation(
        name="sheet 2 upside down",
        causes=("sheets",),
        sizes=(0,),
        unit="",
        draw=lambda f, _s, _r, _g: _box(f, turned=(2,)),
        scale=0.0,
    ),
    Violation(
        name="box upside down",
        causes=("box-upside-down",),
        sizes=(0,),
        unit="",
        draw=_standing((pi, 0.0, 0.0), (0.0, 0.0, 0.2)),
        scale=0.0,
    ),
    Violation(
        name="box on its side",
        causes=("box-on-side",),
        sizes=(0,),
        unit="",
        draw=_standing((pi / 2, 0.0, 0.0), (0.0, 0.1, _SIDE)),
        scale=0.0,
    ),
    Violation(
        name="box on a table",
        causes=("box-raised", "below-floor"),
        sizes=(100.0, 400.0),
        unit="mm",
        draw=lambda f, s, _r, _g: _box(f, standing=rigid(np.eye(3), np.array([0.0, 0.0, s * 1e-3]))),
        scale=0.0,
    ),
    Violation(
        name="print too small",
        causes=("print",),
        sizes=(1.0, 3.0),
        unit="%",
        draw=lambda f, s, _r, _g: _box(f, scale=(1 - s / 100, 1 - s / 100)),
    ),
    Violation(
        name="another box",
        causes=("other-box", "print"),
        sizes=(0,),
        unit="",
        draw=lambda f, _s, _r, _g: _box(f, other=Box(tag_size=0.024, pitch=0.033)),
        scale=0.0,
    ),
    Violation(name="a sheet low", causes=("sheet",), sizes=(1.0,), unit="mm", draw=_face, usual=0.35),
    Violation(
        name="faces bowed",
        causes=("bow", "face"),
        sizes=(1.0,),
        unit="mm",
        draw=lambda f, s, _r, _g: _box(f, bow=(s * 1e-3,) * FACES),
    ),
)
"""What the diagnosis is asked to name."""

HARMLESS: tuple[Violation, ...] = (
    *(
        Violation(
            name="robot leans",
            causes=(),
            sizes=(s,),
            unit="deg",
            draw=lambda f, s, _r, _g: replace(f, lean=radians(s)),
        )
        for s in (0.005, 0.02, 0.05, 0.2)
    ),
    Violation(
        name="a real lens",
        causes=(),
        sizes=(0,),
        unit="",
        draw=lambda f, _s, _r, g: _camera(f, lens=(g.normal(0, 0.15), *g.normal(0, 1e-3, 2), g.normal(0, 0.05))),
    ),
    Violation(
        name="common corner noise",
        causes=(),
        sizes=(0.008, 0.03),
        unit="px",
        draw=lambda f, s, _r, _g: _camera(f, shift=s, spread=s),
    ),
    Violation(
        name="fisheye",
        causes=(),
        sizes=(0,),
        unit="",
        draw=lambda f, _s, _r, g: _camera(f, fisheye=tuple(g.normal(0, (0.02, 0.01, 0.003, 0.001)).tolist())),
    ),
    Violation(
        name="light from one side",
        causes=(),
        sizes=(0.03, 0.1),
        unit="px",
        draw=lambda f, s, _r, _g: _camera(f, side_light=s),
    ),
    Violation(
        name="coarse encoders",
        causes=(),
        sizes=(2.0, 6.0),
        unit="deg",
        draw=lambda f, s, _r, _g: _wheels(f, encoder_step=radians(s)),
    ),
    Violation(
        name="slip differs by leg",
        causes=(),
        sizes=(0.8,),
        unit="",
        draw=lambda f, s, _r, _g: _wheels(f, slip_spread=s),
    ),
    Violation(name="slippery", causes=(), sizes=(5.0,), unit="mm", draw=lambda f, s, _r, _g: _wheels(f, slip=s * 1e-3)),
)
"""What the model as it stands takes in, or should: nothing has to be named."""
