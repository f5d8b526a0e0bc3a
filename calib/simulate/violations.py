"""A catalogue of what goes wrong with robots, boxes and floors, each in one or more sizes, to be drawn at random."""

from dataclasses import replace
from math import pi, radians

import numpy as np

from boxcal.calib.geometry.so3_se3 import rigid
from boxcal.calib.simulate.violation import (
    STOPS,
    Violation,
    box_standing,
    carried_robot,
    counts,
    eccentric_wheels,
    knocked_camera,
    low_sheet,
    moved_box,
    ordered,
    scrubbing_turns,
    slipped_leg,
    with_box,
    with_camera,
    with_wheels,
)
from boxcal.target.box import FACES, Box

_SIDE = 0.125
"""Half the default box' width, m: lying on its side, its middle is that high; its own height is 0.2 m."""

VIOLATIONS: tuple[Violation, ...] = (
    Violation(name="wheels out of round", causes=("eccentric",), sizes=(0.3, 1.0), unit="%", draw=eccentric_wheels),
    Violation(
        name="radius backward",
        causes=("backward",),
        sizes=(0.3, 1.0),
        unit="%",
        draw=lambda f, s, _r, _g: with_wheels(f, backward=s / 100),
    ),
    Violation(
        name="outer wheel in bends",
        causes=("outer",),
        sizes=(0.3, 1.0),
        unit="%",
        draw=lambda f, s, _r, _g: with_wheels(f, outer=s / 100),
    ),
    Violation(
        name="backlash",
        causes=("backlash",),
        sizes=(0.5, 1.0, 2.0),
        unit="deg",
        draw=lambda f, s, _r, _g: with_wheels(f, backlash=radians(s)),
    ),
    Violation(name="turns scrub", causes=("scrub",), sizes=(0.5, 1.2), unit="%", draw=scrubbing_turns, scale=0.0),
    Violation(
        name="scrub on the spot",
        causes=("scrub",),
        sizes=(1.0, 2.0),
        unit="%",
        draw=lambda f, s, _r, _g: with_wheels(f, scrub=(0.0, 0.0, s / 100)),
    ),
    Violation(name="one leg slips", causes=("leg-",), sizes=(3.0, 10.0), unit="mm", draw=slipped_leg),
    Violation(
        name="robot carried",
        causes=("robot-carried", "leg-slipped", "box-moved"),
        sizes=(30.0, 150.0),
        unit="mm",
        draw=carried_robot,
        scale=0.0,
    ),
    Violation(name="box moved", causes=("box-moved",), sizes=(3.0, 6.0), unit="mm", draw=moved_box),
    Violation(name="camera knocked", causes=("camera-knocked",), sizes=(0.1, 0.5), unit="deg", draw=knocked_camera),
    Violation(
        name="focus changed",
        causes=("focus",),
        sizes=(0.2, 1.0),
        unit="%",
        draw=lambda f, s, _r, g: with_camera(f, focus=(int(g.integers(3, STOPS - 3)), 1 + s / 100, 0.0, 0.0)),
    ),
    Violation(
        name="crop changed",
        causes=("focus",),
        sizes=(2.0, 8.0),
        unit="px",
        draw=lambda f, s, _r, g: with_camera(f, focus=(int(g.integers(3, STOPS - 3)), 1.0, s, 0.0)),
        scale=0.0,
    ),
    Violation(
        name="autofocus",
        causes=("focus",),
        sizes=(0.2,),
        unit="%",
        draw=lambda f, s, _r, _g: with_camera(f, autofocus=s / 100),
    ),
    Violation(
        name="camera clock late",
        causes=("clock",),
        sizes=(1.5, 37.0),
        unit="s",
        draw=lambda f, s, _r, _g: with_camera(f, late=s),
    ),
    Violation(
        name="camera clock drifts",
        causes=("clock",),
        sizes=(0.05,),
        unit="s/s",
        draw=lambda f, s, _r, _g: with_camera(f, drift=s),
    ),
    Violation(
        name="encoders restart",
        causes=("encoder-restart", "leg-"),
        sizes=(3.0,),
        unit="rad",
        draw=lambda f, s, _r, g: with_wheels(f, restart=(int(g.integers(STOPS - 1)), s)),
        scale=0.0,
    ),
    Violation(
        name="right counts double",
        causes=("counts",),
        sizes=(2.0,),
        unit="times",
        draw=counts(2.0, 1.0),
        scale=0.0,
    ),
    Violation(name="degrees", causes=("unit",), sizes=(57.3,), unit="", draw=counts(180 / pi, 180 / pi), scale=0.0),
    Violation(
        name="ticks",
        causes=("unit",),
        sizes=(1,),
        unit="",
        draw=counts(180 / pi / 0.1302, 180 / pi / 0.1302),
        scale=0.0,
    ),
    Violation(name="motor turns", causes=("unit",), sizes=(30.0,), unit="times", draw=counts(30.0, 30.0), scale=0.0),
    Violation(
        name="metres",
        causes=("unit",),
        sizes=(1.0,),
        unit="",
        draw=lambda f, _s, r, _g: with_wheels(f, counts=(r.rR, r.rL)),
        scale=0.0,
    ),
    Violation(
        name="wheels swapped", causes=("wheels-swapped",), sizes=(0,), unit="", draw=counts(-1.0, -1.0), scale=0.0
    ),
    Violation(name="left reversed", causes=("wheel-reversed",), sizes=(0,), unit="", draw=counts(1.0, -1.0), scale=0.0),
    Violation(name="sheets 0, 1 swapped", causes=("sheets",), sizes=(0,), unit="", draw=ordered(1, 0, 2, 3), scale=0.0),
    Violation(name="sheets 0, 2 swapped", causes=("sheets",), sizes=(0,), unit="", draw=ordered(2, 1, 0, 3), scale=0.0),
    Violation(name="sheets reversed", causes=("sheets",), sizes=(0,), unit="", draw=ordered(0, 3, 2, 1), scale=0.0),
    Violation(
        name="sheet 2 upside down",
        causes=("sheets",),
        sizes=(0,),
        unit="",
        draw=lambda f, _s, _r, _g: with_box(f, turned=(2,)),
        scale=0.0,
    ),
    Violation(
        name="box upside down",
        causes=("box-upside-down",),
        sizes=(0,),
        unit="",
        draw=box_standing((pi, 0.0, 0.0), (0.0, 0.0, 0.2)),
        scale=0.0,
    ),
    Violation(
        name="box on its side",
        causes=("box-on-side",),
        sizes=(0,),
        unit="",
        draw=box_standing((pi / 2, 0.0, 0.0), (0.0, 0.1, _SIDE)),
        scale=0.0,
    ),
    Violation(
        name="box on a table",
        causes=("box-raised", "below-floor"),
        sizes=(100.0, 400.0),
        unit="mm",
        draw=lambda f, s, _r, _g: with_box(f, standing=rigid(np.eye(3), np.array([0.0, 0.0, s * 1e-3]))),
        scale=0.0,
    ),
    Violation(
        name="print too small",
        causes=("print",),
        sizes=(1.0, 3.0),
        unit="%",
        draw=lambda f, s, _r, _g: with_box(f, scale=(1 - s / 100, 1 - s / 100)),
    ),
    Violation(
        name="another box",
        causes=("other-box", "print"),
        sizes=(0,),
        unit="",
        draw=lambda f, _s, _r, _g: with_box(f, other=Box(tag_size=0.024, pitch=0.033)),
        scale=0.0,
    ),
    Violation(name="a sheet low", causes=("sheet",), sizes=(1.0,), unit="mm", draw=low_sheet, usual=0.35),
    Violation(
        name="faces bowed",
        causes=("bow", "face"),
        sizes=(1.0,),
        unit="mm",
        draw=lambda f, s, _r, _g: with_box(f, bow=(s * 1e-3,) * FACES),
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
        draw=lambda f, _s, _r, g: with_camera(f, lens=(g.normal(0, 0.15), *g.normal(0, 1e-3, 2), g.normal(0, 0.05))),
    ),
    Violation(
        name="common corner noise",
        causes=(),
        sizes=(0.008, 0.03),
        unit="px",
        draw=lambda f, s, _r, _g: with_camera(f, shift=s, spread=s),
    ),
    Violation(
        name="fisheye",
        causes=(),
        sizes=(0,),
        unit="",
        draw=lambda f, _s, _r, g: with_camera(f, fisheye=tuple(g.normal(0, (0.02, 0.01, 0.003, 0.001)).tolist())),
    ),
    Violation(
        name="light from one side",
        causes=(),
        sizes=(0.03, 0.1),
        unit="px",
        draw=lambda f, s, _r, _g: with_camera(f, side_light=s),
    ),
    Violation(
        name="coarse encoders",
        causes=(),
        sizes=(2.0, 6.0),
        unit="deg",
        draw=lambda f, s, _r, _g: with_wheels(f, encoder_step=radians(s)),
    ),
    Violation(
        name="slip differs by leg",
        causes=(),
        sizes=(0.8,),
        unit="",
        draw=lambda f, s, _r, _g: with_wheels(f, slip_spread=s),
    ),
    Violation(
        name="slippery", causes=(), sizes=(5.0,), unit="mm", draw=lambda f, s, _r, _g: with_wheels(f, slip=s * 1e-3)
    ),
)
"""What the model as it stands takes in, or should: nothing has to be named."""
