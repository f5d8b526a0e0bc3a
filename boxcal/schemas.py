"""JSON Schemas of the files that boxcal writes, made from the dataclasses that are saved in them.

``boxcal schemas FOLDER`` writes them; those of this version are kept in ``docs/schemas``.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from boxcal.command_line import CommandParser
from boxcal.json_schema import NUMBER, NUMBER_OR_NULL, Schema, attributes, matrix, of_dataclass, record

DIALECT = "https://json-schema.org/draft/2020-12/schema"


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
    return _document(
        "target.json",
        "A landmark box: its design, its tags' corners and, where known, its true size and shape.",
        SCHEMA,
        {
            "units": {"const": "m"},
            "frame": _text("Of all coordinates."),
            "corner_order": _text("Of a tag's corners."),
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
    schema = _document(
        "correspondences.npz: header",
        "What a robot saw at each stop of one drive, and what its wheels did between: the numbers beside the arrays.",
        SCHEMA,
        {
            "robot": _text("Name of the robot."),
            "image_size": _image_size(),
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


def calibration_schema() -> Schema:
    """Return the schema of ``calibration.json``."""
    from boxcal.calib.geometry.diff_drive import Wheels
    from boxcal.calib.likelihood.finding import Finding
    from boxcal.calib.results.calibration import Calibration, Provenance, Quality, StopResult
    from boxcal.calib.results.diagnostics import CAMERA
    from boxcal.calib.results.json_format import SCHEMA
    from boxcal.calib.results.verdict import Verdict
    from boxcal.target.camera.camera_model import CameraModel

    said = attributes(Calibration)
    stop = of_dataclass(StopResult, {"T_box_cam": matrix(4, 4, "m")})
    always: dict[str, Schema] = {
        "robot": _text(said["robot"]),
        "camera": of_dataclass(CameraModel, only=CAMERA),
        "image_size": _image_size(),
        "wheels": of_dataclass(Wheels),
        "T_body_cam": {**matrix(4, 4, "m"), "description": said["T_body_cam"]},
        "quality": of_dataclass(Quality),
        "stops": {"type": "array", "items": stop, "description": said["stops"]},
        "notes": {"type": "array", "items": {"type": "string"}, "description": said["notes"]},
        "provenance": of_dataclass(Provenance),
        "units": _text("Of the numbers in this file."),
        "method": {"enum": ["likelihood", "four-steps"], "description": said["method"]},
        "lens": _lens(),
    }
    findings = {
        "type": "array",
        "items": of_dataclass(Finding, nullable=True),
        "description": said["findings"],
    }
    sometimes: dict[str, Schema] = {
        "verdict": of_dataclass(Verdict),
        "findings": findings,
        **_of_likelihood(),
        **_of_several_cameras(),
    }
    return _document(
        "calibration.json",
        "The calibration of one robot; fields from sigma on are there unless method is four-steps. Null stands for "
        "what is infinite or undefined.",
        SCHEMA,
        always | sometimes,
        optional=tuple(sometimes),
    )


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
    return _document(
        "plan.json",
        "A planned drive around the box.",
        SCHEMA,
        {
            "robot": _text(plan["robot"]),
            "image_size": _image_size(),
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
            "length": {**NUMBER, "description": "Way of the body, m."},
            "reached": {"type": "boolean", "description": plan["reached"]},
        },
    )


def matrix_row(count: int) -> Schema:
    """Return the schema of a list of so many numbers."""
    return {"type": "array", "items": NUMBER, "minItems": count, "maxItems": count}


def _of_likelihood() -> dict[str, Schema]:
    """Return the schemas of the fields that the likelihood adds to a calibration."""
    from boxcal.calib.geometry.parameters import ORDER
    from boxcal.calib.likelihood.estimate import FlaggedCorner, FlaggedLeg, NoiseLevels
    from boxcal.calib.results.diagnostics import Detail, Ground, HeldOut, LeaveOneOut, Leg
    from boxcal.calib.uncertainty.convergence import ConvergencePoint

    said = attributes(Detail)

    def many(kind: type, what: str) -> Schema:
        return {"type": "array", "items": of_dataclass(kind, nullable=True), "description": what}

    words = {"type": "string"}
    both = _covariance("", {"type": "array", "items": words})
    direction = {
        "parameters": {"type": "array", "items": {"type": "array", "prefixItems": [words, NUMBER]}},
        "sigma": NUMBER_OR_NULL,
        **dict.fromkeys(("what", "advice", "text"), words),
    }
    return {
        "sigma": _named("Standard deviation of each parameter, in its own unit; null where it is not determined."),
        "covariance": _covariance(said["covariance"], {"const": list(ORDER)}),
        "noise": of_dataclass(NoiseLevels, nullable=True),
        "camera_covariance": {"anyOf": [both, {"type": "null"}], "description": said["camera_covariance"]},
        "leave_one_out": {
            "anyOf": [of_dataclass(LeaveOneOut, nullable=True), {"type": "null"}],
            "description": said["leave_one_out"],
        },
        "effects": _named(said["effects"]),
        "scale_sigma": {**NUMBER_OR_NULL, "description": said["scale_sigma"]},
        "extra": _named(said["extra"]),
        "extra_sigma": _named(said["extra_sigma"]),
        "ground": of_dataclass(Ground, nullable=True),
        "legs": many(Leg, said["legs"]),
        "flagged_legs": many(FlaggedLeg, said["flagged_legs"]),
        "flagged_corners": many(FlaggedCorner, said["flagged_corners"]),
        "directions": {
            "type": "array",
            "items": record(direction, "", optional=("what", "advice")),
            "description": said["directions"],
        },
        "held_out": many(HeldOut, said["held_out"]),
        "growth": many(ConvergencePoint, said["growth"]),
    }


def _of_several_cameras() -> dict[str, Schema]:
    """Return the schemas of the fields that a robot with several cameras adds to a calibration."""
    from boxcal.calib.geometry.parameters import MOUNTING, ORDER
    from boxcal.calib.results.diagnostics import CAMERA, SIDE
    from boxcal.calib.results.rig import CameraPair, Rig, RigCamera
    from boxcal.calib.results.rig_json import PAIR_SIDE
    from boxcal.target.camera.camera_model import CameraModel

    rig, pair, texts = attributes(Rig), attributes(CameraPair), {"type": "array", "items": {"type": "string"}}
    rows = {"type": "array", "items": {"type": "array", "items": NUMBER_OR_NULL}}
    parts = {"camera": of_dataclass(CameraModel, only=CAMERA), "T_body_cam": matrix(4, 4, "m")}
    own = record({"order": {"const": list(ORDER)}, "side": {"const": SIDE}, "matrix": rows}, "")
    parts |= {"image_size": _image_size(), "covariance": own}
    camera = of_dataclass(RigCamera, parts)
    camera["properties"]["lens"] = _lens()
    camera["required"] = sorted(set(camera["properties"]) - {"landmarks", "verdict", "why", "covariance"})
    of_pair = {
        "a": _text(pair["a"]),
        "b": _text(pair["b"]),
        "T_a_b": {**matrix(4, 4, "m"), "description": pair["T_a_b"]},
        "sigma": _named("Standard deviations of rx, ry, rz (rad), tx, ty, tz (m)."),
        "covariance": record(
            {"order": {"const": list(ORDER[MOUNTING])}, "side": {"const": PAIR_SIDE}, "matrix": rows},
            pair["covariance"],
        ),
    }
    return {
        "cameras": {"type": "array", "items": camera, "description": rig["cameras"]},
        "camera_pairs": {
            "type": "array",
            "items": record(of_pair, "Transform between two cameras."),
            "description": "All pairs of cameras, each once.",
        },
        "cameras_covariance": record({"order": texts, "matrix": rows}, rig["covariance"]),
        "cameras_left_out": {
            "type": "array",
            "items": record({"topic": _text("Image topic."), "why": _text("Reason.")}, "An image topic left out."),
            "description": rig["left_out"],
        },
        "cameras_apart": _text(rig["apart"]),
        "cameras_stops": {"type": "integer", "minimum": 0, "description": rig["stops"]},
    }


def _lens() -> Schema:
    from boxcal.target.camera.distortion import CameraKind

    parts = {
        "model": {"enum": [str(kind) for kind in CameraKind]},
        "coefficients": _named("Distortion coefficients beyond kr by name, which their order may not replace."),
    }
    return record(parts, "Camera model.")


def _covariance(what: str, order: Schema) -> Schema:
    from boxcal.calib.results.diagnostics import SIDE

    rows = {"type": "array", "items": {"type": "array", "items": NUMBER_OR_NULL}}
    return record({"order": order, "side": {"const": SIDE}, "matrix": rows}, what)


def _named(what: str) -> Schema:
    return {"type": "object", "additionalProperties": NUMBER_OR_NULL, "description": what}


def _document(
    title: str, what: str, number: int, properties: Mapping[str, Schema], optional: Sequence[str] = ()
) -> Schema:
    schema = {"const": number, "description": "Number of this format; fields may be added, none is removed or renamed."}
    return {"$schema": DIALECT, "title": title, **record({"schema": schema, **properties}, what, optional)}


def _text(what: str) -> Schema:
    return {"type": "string", "description": what}


def _image_size() -> Schema:
    return {
        "type": "array",
        "items": {"type": "integer", "minimum": 1},
        "minItems": 2,
        "maxItems": 2,
        "description": "[px] Width and height of the camera's images.",
    }
