"""``plan.json``: a plan as other programs read it."""

import json
from typing import Any

import numpy as np

from boxcal.calib.planning.goal import Bar
from boxcal.calib.planning.plan import DrivePlan, PlannedStop

SCHEMA = 1
PLAN = "plan.json"
"""File name of a plan."""
UNITS = "m, rad, px, s; poses of the body (x forward, origin on the floor below the axle) in frame box"


def plan_document(plan: DrivePlan) -> dict[str, Any]:
    """Return the content of ``plan.json``."""
    robot, box = plan.robot, plan.target.box
    return {
        "schema": SCHEMA,
        "robot": robot.name,
        "image_size": list(robot.image_size),
        "units": UNITS,
        "box": [box.width, box.depth, box.height],
        "seed": plan.options.seed,
        "criterion": str(plan.options.criterion),
        "floor": {
            "bounds": list(plan.options.floor.bounds),
            "obstacles": [list(o) for o in plan.options.floor.obstacles],
            "clearance": plan.options.floor.clearance,
        },
        "slip": plan.assumptions.slip,
        "corner_px": plan.assumptions.corner_px,
        "stops": [stop_document(stop) for stop in plan.stops],
        "figures": [bar_document(bar) for bar in plan.bars],
        "seconds": round(plan.seconds, 1),
        "length": round(plan.length, 3),
        "reached": plan.reached,
    }


def stop_document(stop: PlannedStop) -> dict[str, Any]:
    """Return one stop as JSON has it."""
    x, y, heading = (round(float(v), 4) for v in stop.pose)
    return {
        "x": x,
        "y": y,
        "heading": heading,
        "tags": stop.tags,
        "faces": list(stop.faces),
        "way": [
            {"distance": round(float(d), 4), "turn": round(float(t), 4)}
            for d, t in zip(stop.distance, stop.turn, strict=True)
        ],
    }


def bar_document(bar: Bar) -> dict[str, Any]:
    """Return one value as JSON has it; undetermined values are null."""
    return {
        "name": bar.name,
        "label": bar.label,
        "unit": bar.unit,
        "value": float(f"{bar.value:.4g}") if np.isfinite(bar.value) else None,
        "goal": float(f"{bar.goal:.6g}"),
    }


def plan_bytes(plan: DrivePlan) -> bytes:
    """Return the bytes of ``plan.json``."""
    return (json.dumps(plan_document(plan), indent=2, allow_nan=False) + "\n").encode()
