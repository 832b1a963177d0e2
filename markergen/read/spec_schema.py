"""The published JSON Schema of a spec file: the declared options of a design, and the tables that they may be."""

from typing import Any

from pydantic import TypeAdapter

from markergen.model.shape_file import BoundaryFile, HoleFile
from markergen.options import OUTSIDE_FILES, DesignKeywords, Option, PlateKeywords, declared
from markergen.read.spec_file import CameraTable, ImageNoiseTable

_TEXT: dict[str, Any] = {"type": "string"}
_LENGTH: dict[str, Any] = {"type": ["number", "string"]}
_SHAPE: dict[str, Any] = {"anyOf": [_TEXT, {"$ref": "#/$defs/Boundary"}]}
KINDS: dict[str, dict[str, Any]] = {
    "int": {"type": "integer"},
    "float": {"type": "number"},
    "bool": {"type": "boolean"},
    "str": _TEXT,
    "length": _LENGTH,
    "length or auto": _LENGTH,
    "shape": _SHAPE,
    "shapes": {"type": "array", "items": _SHAPE},
    "texts": {"anyOf": [_TEXT, {"type": "array", "items": _TEXT}]},
    "camera": {"anyOf": [_TEXT, {"$ref": "#/$defs/Camera"}]},
    "poses": _TEXT,
}
"""What stands in a file for each kind of option; lengths are meters, or text with a unit."""


def spec_schema() -> dict[str, Any]:
    """JSON Schema of a spec file, which editors of TOML check and complete by."""
    options = {name: option for name, option in declared(DesignKeywords).items() if name not in OUTSIDE_FILES}
    keys = {key: _described(option) for option in options.values() for key in (option.name, *option.aliases)}
    plate = {name: _described(option) for name, option in declared(PlateKeywords).items()}
    boundary, hole = _lengths_as_text([TypeAdapter(BoundaryFile).json_schema(), HoleFile.model_json_schema()])
    tables = {"Boundary": boundary, "Camera": CameraTable.model_json_schema()}
    definitions: dict[str, Any] = {}
    for name, table in tables.items():
        definitions |= table.pop("$defs", {})
        definitions[name] = table
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Spec of a design",
        "description": "What markergen design is asked for; lengths are meters, or text with a unit such as 150mm.",
        "type": "object",
        "properties": {
            "title": {"type": "string", "description": "What it is for, in a line."},
            **keys,
            "image_noise": ImageNoiseTable.model_json_schema(),
            "substrate": {
                "type": "object",
                "description": "The plate: the same keys as outside of this table, and its holes one by one.",
                "properties": {
                    **plate,
                    "holes": {"type": "array", "items": hole},
                },
                "additionalProperties": False,
            },
        },
        "additionalProperties": False,
        "$defs": definitions,
    }


def _described(option: Option) -> dict[str, Any]:
    words = f"{option.help} Default: {option.shown}." if option.shown else option.help
    default = {} if option.default is None else {"default": option.default}
    return {**KINDS[option.kind], "description": words, **default}


def _lengths_as_text(schema: Any) -> Any:
    """Return a schema in which every number may also be text with a unit, as spec files may have it."""
    if isinstance(schema, list):
        return [_lengths_as_text(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "number":
        return {**schema, "type": ["number", "string"]}
    return {key: _lengths_as_text(value) for key, value in schema.items()}
