"""JSON Schemas of the files that boxcal writes, made from the dataclasses that are saved in them.

``boxcal schemas FOLDER`` writes them; those of this version are kept in ``docs/schemas``.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from boxcal.calibration_schema import calibration_schema
from boxcal.command_line import CommandParser
from boxcal.json_schema import (
    NUMBER,
    NUMBER_OR_NULL,
    Schema,
    attributes,
    document,
    image_size,
    matrix,
    of_dataclass,
    record,
    text,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``boxcal schemas``; return 0 if all schemas were written, 1 if not (argparse exits with 2)."""
    parser = CommandParser(
        "boxcal schemas",
        description="example:\n  boxcal schemas schemas\n\n"
        "Write JSON Schemas of calibration.json, target.json, plan.json and of the header in correspondences.npz.",
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where to write")
    folder = parser.parse_args(argv).folder
    from boxcal.target.files.atomic_write import write_atomically

    try:
        for name, schema in all_schemas().items():
            write_atomically(folder / f"{name}.schema.json", schema_bytes(schema))
    except OSError as error:
        sys.stderr.write(
            f"boxcal schemas: {folder}: cannot be written ({error.strerror or error}); name another FOLDER\n"
        )
        return 1
    return 0


def schema_bytes(schema: Schema) -> bytes:
    """Return a schema as it is written."""
    return (json.dumps(schema, indent=2, ensure_ascii=False) + "\n").encode()


def all_schemas() -> dict[str, Schema]:
    """Return the schemas by the stem of their file."""
    return {
        "calibration": calibration_schema(),
        "target": target_schema(),
        "correspondences": correspondences_schema(),
        "plan": plan_schema(),
    }


def target_schema() -> Schema:
    """Return the schema of ``target.json``."""
    from boxcal.target.box import Box
    from boxcal.target.files.target_json import SCHEMA
    from boxcal.target.measure.measured_size import SIZES, Measured
    from boxcal.target.measure.refined_shape import SHAPE, RefinedShape

    measured = of_dataclass(Measured, {"cov": matrix(len(SIZES), len(SIZES), "m^2 for lengths, none for scales")})
    measured["properties"]["cov_order"] = {"const": list(SIZES), "description": "Rows and columns of cov."}
    measured["required"] = sorted(measured["properties"])
    numbers = {"type": "array", "items": NUMBER, "minItems": len(SHAPE), "maxItems": len(SHAPE)}
    refined = of_dataclass(RefinedShape, {"values": numbers, "cov": matrix(len(SHAPE), len(SHAPE), "as the values")})
    refined["properties"]["order"] = {"const": list(SHAPE), "description": "Of values, and rows and columns of cov."}
    refined["required"] = sorted(refined["properties"])
    return document(
        "target.json",
        "A landmark box: its design, its tags' corners and, where known, its true size and shape.",
        SCHEMA,
        {
            "units": {"const": "m"},
            "frame": text("Of all coordinates."),
            "corner_order": text("Of a tag's corners."),
            "box": of_dataclass(Box),
            "measured": measured,
            "refined": refined,
            "tags": {
                "type": "object",
                "description": "Tag id -> its four corners in frame box, m.",
                "propertyNames": {"pattern": "^[0-9]+$"},
                "additionalProperties": matrix(4, 3, "m"),
            },
        },
        optional=("measured", "refined"),
    )


def correspondences_schema() -> Schema:
    """Return the schema of the JSON text in the array ``header`` of ``correspondences.npz``.

    Under ``arrays`` it says what the other arrays of the archive hold; that is for people, a validator skips it.
    """
    from boxcal.detect.correspondences import SCHEMA, StopObservation
    from boxcal.detect.log.source import Source
    from boxcal.detect.log.wheel_samples import WheelSamples, WheelUnits
    from boxcal.detect.tags.moving_frames import MovingFrame

    stop, frame = (of_dataclass(kind, skip_arrays=True) for kind in (StopObservation, MovingFrame))
    schema = document(
        "correspondences.npz: header",
        "What a robot saw at each stop of one drive, and what its wheels did between: the numbers beside the arrays.",
        SCHEMA,
        {
            "robot": text("Name of the robot."),
            "image_size": image_size(),
            "source": of_dataclass(Source),
            "encoder_steps": of_dataclass(WheelSamples, skip_arrays=True)["properties"]["encoder_steps"],
            "units": of_dataclass(WheelUnits),
            "stops": {"type": "array", "items": stop, "description": "In order of time."},
            "moving": {"type": "array", "items": frame, "description": "Frames taken between stops, in order of time."},
            "on_the_move": {
                "type": "boolean",
                "description": "Whether the stops are single frames of a robot that stood still at too few places.",
            },
        },
        optional=("encoder_steps", "units", "moving", "on_the_move"),
    )
    arrays = {name: text for name, text in attributes(WheelSamples).items() if name != "encoder_steps"}
    own = set(stop["properties"])
    arrays |= {f"stop<number>_{name}": text for name, text in attributes(StopObservation).items() if name not in own}
    arrays |= {f"moving<number>_{name}": text for name, text in attributes(MovingFrame).items() if name != "t_ns"}
    return {**schema, "arrays": {"header": "This document, UTF-8 bytes.", **arrays}}


def plan_schema() -> Schema:
    """Return the schema of ``plan.json``."""
    from boxcal.calib.plan_drive.plan_json import SCHEMA, UNITS
    from boxcal.calib.planning.assumptions import Assumptions
    from boxcal.calib.planning.floor import Floor
    from boxcal.calib.planning.goal import Bar
    from boxcal.calib.planning.objective import Criterion
    from boxcal.calib.planning.plan import DrivePlan, PlannedStop, PlanOptions

    plan, stop, noise = attributes(DrivePlan), attributes(PlannedStop), attributes(Assumptions)
    whole: Schema = {"type": "integer", "minimum": 0}
    arc = record(
        {
            "distance": {**NUMBER, "description": "Of the body's origin, m; negative backwards."},
            "turn": {**NUMBER, "description": "Change of heading, rad, to the left."},
        },
        "An arc from standstill to standstill.",
    )
    stops = {
        "x": {**NUMBER, "description": "Of the body, m."},
        "y": {**NUMBER, "description": "Of the body, m."},
        "heading": {**NUMBER, "description": "Of the body, rad; runs on from stop to stop, whole turns counted."},
        "tags": {**whole, "description": stop["tags"]},
        "faces": {"type": "array", "items": whole, "description": stop["faces"]},
        "way": {"type": "array", "items": arc, "description": "Arcs from the stop before; none at the first."},
    }
    figure = {name: {"type": "string"} for name in ("name", "label", "unit")}
    said = attributes(Bar)
    number = {
        "value": {**NUMBER_OR_NULL, "description": said["value"]},
        "goal": {**NUMBER, "description": said["goal"]},
    }
    return document(
        "plan.json",
        "A planned drive around the box.",
        SCHEMA,
        {
            "robot": text(plan["robot"]),
            "image_size": image_size(),
            "units": {"const": UNITS},
            "box": {**matrix_row(3), "description": "Width, depth and height, m."},
            "seed": {**whole, "description": attributes(PlanOptions)["seed"]},
            "criterion": {"enum": [str(c) for c in Criterion], "description": attributes(PlanOptions)["criterion"]},
            "floor": of_dataclass(Floor),
            "slip": {**NUMBER, "description": noise["slip"]},
            "corner_px": {**NUMBER, "description": noise["corner_px"]},
            "stops": {"type": "array", "items": record(stops, "A stop."), "description": plan["stops"]},
            "figures": {
                "type": "array",
                "items": record({**figure, **number}, "A figure."),
                "description": plan["bars"],
            },
            "seconds": {**NUMBER, "description": "Time that the drive takes, s."},
            "length": {**NUMBER, "description": "Length of the path of the body, m."},
            "reached": {"type": "boolean", "description": plan["reached"]},
        },
    )


def matrix_row(count: int) -> Schema:
    """Return the schema of a list of so many numbers."""
    return {"type": "array", "items": NUMBER, "minItems": count, "maxItems": count}
