"""JSON Schemas of dataclasses (types from annotations, descriptions from docstrings) and of files made of them."""

import re
import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from enum import Enum
from inspect import cleandoc
from typing import Any, Union, get_args, get_origin, get_type_hints

Schema = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"

NUMBER: Schema = {"type": "number"}
NUMBER_OR_NULL: Schema = {"type": ["number", "null"]}


def of_dataclass(
    kind: type,
    given: Mapping[str, Schema] | None = None,
    *,
    nullable: bool = False,
    skip_arrays: bool = False,
    only: Sequence[str] | None = None,
) -> Schema:
    """Return the schema of a dataclass as it is saved: types from its annotations, descriptions from its docstring.

    Parameters
    ----------
    kind
        The dataclass.
    given
        Schemas of fields whose annotation does not say, such as arrays.
    nullable
        Whether numbers may be null (infinite or undefined).
    skip_arrays
        Leave out fields that hold numpy arrays and are not given.
    only
        The fields that are saved, where it is not all of them; all of these are required.
    """
    hints, texts = get_type_hints(kind), attributes(kind)
    properties: dict[str, Schema] = {}
    required = []
    for field in fields(kind):
        if field.name.startswith("_") or (only is not None and field.name not in only):
            continue
        if given and field.name in given:
            schema = given[field.name]
        elif skip_arrays and _is_array(hints[field.name]):
            continue
        else:
            schema = _of(hints[field.name], nullable)
        properties[field.name] = {**schema, "description": texts[field.name]}
        if only is not None or (field.default is MISSING and field.default_factory is MISSING):
            required.append(field.name)
    summary = cleandoc(kind.__doc__ or "").partition("\n")[0]
    return {"type": "object", "description": summary, "properties": properties, "required": required}


_SIMPLE: dict[Any, Schema] = {
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    str: {"type": "string"},
    Any: {},
    object: {},
}


def _of(hint: Any, nullable: bool) -> Schema:
    """Return the schema of a type annotation."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is float:
        return NUMBER_OR_NULL if nullable else NUMBER
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    if origin in {Union, types.UnionType}:
        return {"anyOf": [{"type": "null"} if part is type(None) else _of(part, nullable) for part in inner]}
    if origin is tuple:
        return _tuple(inner, nullable)
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _of(inner[1], nullable)}
    return _enum(hint) if issubclass(hint, Enum) else of_dataclass(hint, nullable=nullable)


def _tuple(inner: tuple[Any, ...], nullable: bool) -> Schema:
    if inner[-1] is Ellipsis:
        return {"type": "array", "items": _of(inner[0], nullable)}
    items = [_of(part, nullable) for part in inner]
    return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}


def _enum(kind: type[Enum]) -> Schema:
    return {"enum": [member.value for member in kind]}


def _is_array(hint: Any) -> bool:
    return "ndarray" in str(get_origin(hint) or hint)


def attributes(kind: type) -> dict[str, str]:
    """Return what the NumPy docstring of a dataclass says of each attribute, its shape and unit first."""
    section = re.search(r"^Attributes\n-+\n(.*?)(?:\n\n\S|\Z)", cleandoc(kind.__doc__ or ""), re.DOTALL | re.MULTILINE)
    found: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", section[1] if section else ""):
        head, _, text = entry.partition("\n")
        names, _, unit = head.partition(" : ")
        said = " ".join(text.split())
        for name in names.split(", "):
            found[name.strip()] = f"[{unit.strip()}] {said}" if unit.strip() else said
    return found


def record(properties: Mapping[str, Schema], what: str, optional: Sequence[str] = ()) -> Schema:
    """Return the schema of an object with these properties, all of them required but the optional ones."""
    return {
        "type": "object",
        **({"description": what} if what else {}),
        "properties": dict(properties),
        "required": [name for name in properties if name not in optional],
    }


def matrix(rows: int, columns: int, unit: str) -> Schema:
    """Return the schema of a matrix as rows of numbers."""
    row = {"type": "array", "items": NUMBER, "minItems": columns, "maxItems": columns}
    return {"type": "array", "items": row, "minItems": rows, "maxItems": rows, "description": f"[{unit}]"}


def document(
    title: str, what: str, number: int, properties: Mapping[str, Schema], optional: Sequence[str] = ()
) -> Schema:
    """Return the schema of a whole file, with the number of its format."""
    schema = {"const": number, "description": "Number of this format; fields may be added, none is removed or renamed."}
    return {"$schema": DIALECT, "title": title, **record({"schema": schema, **properties}, what, optional)}


def text(what: str) -> Schema:
    """Return the schema of a text."""
    return {"type": "string", "description": what}


def image_size() -> Schema:
    """Return the schema of the size of a camera's images."""
    return {
        "type": "array",
        "items": {"type": "integer", "minimum": 1},
        "minItems": 2,
        "maxItems": 2,
        "description": "[px] Width and height of the camera's images.",
    }
