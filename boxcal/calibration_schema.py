"""JSON Schema of ``calibration.json``: what every calibration has, what the likelihood and several cameras add."""

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
        "robot": text(said["robot"]),
        "camera": of_dataclass(CameraModel, only=CAMERA),
        "image_size": image_size(),
        "wheels": of_dataclass(Wheels),
        "T_body_cam": {**matrix(4, 4, "m"), "description": said["T_body_cam"]},
        "quality": of_dataclass(Quality),
        "stops": {"type": "array", "items": stop, "description": said["stops"]},
        "notes": {"type": "array", "items": {"type": "string"}, "description": said["notes"]},
        "provenance": of_dataclass(Provenance),
        "units": text("Of the numbers in this file."),
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
    return document(
        "calibration.json",
        "The calibration of one robot; fields from sigma on are there unless method is four-steps. Null stands for "
        "what is infinite or undefined.",
        SCHEMA,
        always | sometimes,
        optional=tuple(sometimes),
    )


def _of_likelihood() -> dict[str, Schema]:
    """Return the schemas of the fields that the likelihood adds to a calibration."""
    from boxcal.calib.geometry.parameters import ORDER
    from boxcal.calib.likelihood.estimate import FlaggedCorner, FlaggedLeg, NoiseLevels
    from boxcal.calib.results.diagnostics import Detail, Ground, HeldOut, LeaveOneOut, Leg
    from boxcal.calib.uncertainty.convergence_point import ConvergencePoint

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
    parts |= {"image_size": image_size(), "covariance": own}
    camera = of_dataclass(RigCamera, parts)
    camera["properties"]["lens"] = _lens()
    camera["required"] = sorted(set(camera["properties"]) - {"landmarks", "verdict", "why", "covariance"})
    of_pair = {
        "a": text(pair["a"]),
        "b": text(pair["b"]),
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
            "items": record({"topic": text("Image topic."), "why": text("Reason.")}, "An image topic left out."),
            "description": rig["left_out"],
        },
        "cameras_apart": text(rig["apart"]),
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
