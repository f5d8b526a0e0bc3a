"""The JSON Schemas: made from the code, true of every file that is written, and strict enough to reject others."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import boxcal
from boxcal.__main__ import main
from boxcal.calib.plan_drive.plan_json import plan_document
from boxcal.calib.planning.plan import PlanOptions, plan_drive
from boxcal.calib.results.json_format import calibration_document
from boxcal.calib.settings import Settings
from boxcal.calib.simulate.robot import turtlebot
from boxcal.detect.tags.moving_frames import MovingFrame
from boxcal.json_schema import Schema
from boxcal.schemas import all_schemas
from boxcal.target.files.target_json import target_document
from boxcal.target.measure.measured_size import Measured
from boxcal.target.measure.refined_shape import RefinedShape

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, Any]]]:
    """Documents of each kind: with and without what is optional."""
    simulated = boxcal.simulate(stops=6, seed=2)
    drive, target = simulated.correspondences, simulated.target
    path = tmp_path_factory.mktemp("saved") / "correspondences.npz"
    drive.save(path)
    full = boxcal.calibrate(drive, target, settings=Settings(validate=True, report=True))
    closed = boxcal.calibrate(drive, target, settings=Settings(closed_form=True))
    size = Measured(sx=1.001, sy=0.999, width=0.251, depth=0.25, height=0.2, cov=np.eye(5) * 1e-8)
    shape = RefinedShape(values=np.zeros(31), cov=np.eye(31) * 1e-8, robots=2, drives=("0f", "1e"))
    boxes = [(None, None), (size, None), (None, shape), (size, shape)]
    return {
        "calibration": [calibration_document(full), calibration_document(closed)],
        "target": [target_document(boxcal.make_target(measured=m, refined=r)) for m, r in boxes],
        "plan": [plan_document(plan_drive(turtlebot(), target, PlanOptions(stops=3, candidates=30)))],
        "correspondences": [json.loads(bytes(np.load(path)["header"]))],
    }


@pytest.mark.parametrize("name", all_schemas())
def test_the_schemas_that_are_kept_are_those_of_the_code(name: str, tmp_path: Path) -> None:
    """`make schemas` writes them anew."""
    assert main(["schemas", str(tmp_path)]) == 0
    file = f"{name}.schema.json"
    assert (ROOT / "docs" / "schemas" / file).read_text() == (tmp_path / file).read_text()


@pytest.mark.parametrize("name", all_schemas())
def test_files_that_are_written_keep_to_their_schema(name: str, documents: dict[str, list[dict[str, Any]]]) -> None:
    schema = all_schemas()[name]
    jsonschema.Draft202012Validator.check_schema(schema)
    for document in documents[name]:
        plain = json.loads(json.dumps(document, allow_nan=False))
        jsonschema.validate(plain, schema)
        assert not list(_undescribed(plain, schema)), "fields that the schema does not know"


@pytest.mark.parametrize("name", all_schemas())
def test_files_that_lack_a_field_or_have_another_type_do_not(
    name: str, documents: dict[str, list[dict[str, Any]]]
) -> None:
    schema = all_schemas()[name]
    holds = jsonschema.validators.validator_for(schema)(schema).is_valid
    good = json.loads(json.dumps(documents[name][0]))
    assert holds(good)
    for field in schema["required"]:
        for value in (None, [1, "two", {}], "\u2713" if field != "robot" else 7):
            if isinstance(value, str) and schema["properties"][field].get("type") == "string":
                continue
            assert not holds({**good, field: value}), (field, value)
        assert not holds({name: kept for name, kept in good.items() if name != field}), field


def test_the_schema_lists_every_array_of_saved_correspondences(tmp_path: Path) -> None:
    drive = boxcal.simulate(stops=3, seed=1).correspondences
    seen = {name: getattr(drive.stops[0], name) for name in ("landmark_ids", "p_box", "faces", "uv_px", "cov_px2")}
    replace(drive, moving=(MovingFrame(t_ns=1, **seen),)).save(tmp_path / "drive.npz")
    with np.load(tmp_path / "drive.npz") as saved:
        names = {re.sub(r"^(stop|moving)\d+_", r"\1<number>_", name) for name in saved}
    assert names == set(all_schemas()["correspondences"]["arrays"])


def _undescribed(value: Any, schema: Schema, path: str = "$") -> Iterator[str]:
    """Yield the paths of fields that a schema says nothing about."""
    for option in schema.get("anyOf", ()):
        if option.get("type") == "object":
            schema = option
    if isinstance(value, dict):
        known, others = schema.get("properties", {}), schema.get("additionalProperties")
        for name, inner in value.items():
            if name in known:
                yield from _undescribed(inner, known[name], f"{path}.{name}")
            elif others is not None:
                yield from _undescribed(inner, others, f"{path}.{name}")
            elif known:
                yield f"{path}.{name}"
    elif isinstance(value, list):
        for inner in value:
            yield from _undescribed(inner, schema.get("items", {}), f"{path}[]")
