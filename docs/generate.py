"""Write what follows from code, tests and templates: schemas of files, the command-line reference, pages.

python -m docs.generate
"""

import json
from pathlib import Path
from typing import Any

import typer
from pydantic import TypeAdapter

from docs.damage import page_of_damage
from markergen.api.shipped import overview
from markergen.cli.commands import app
from markergen.cli.options import Help
from markergen.model.body_json import RigFile
from markergen.model.marker_file import SINCE, VERSIONS, MarkerFile
from markergen.model.shape_file import BoundaryFile, HoleFile
from markergen.options import Option, declared
from markergen.options.declarations import OUTSIDE_SPEC, DesignKeywords
from markergen.options.shared import PlateKeywords
from markergen.read.spec_file import CameraTable, ImageNoiseTable
from markergen.read.templates import template_text

HERE = Path(__file__).parent
DIALECT = "https://json-schema.org/draft/2020-12/schema"

TEMPLATES = """# Templates

Ready-made specs for common uses, each to be designed as it is or edited. `markergen templates` lists them, and
`markergen templates NAME > my.toml` copies one; put your own camera in. A flag beside `--template` replaces what the
file says. Each is designed, rendered, found, validated and exported as it is shipped by `make test-long`; the pictures
are made by `python -m docs.pictures_of_templates docs/images/templates`.
"""


def json_schema(version: int) -> dict[str, Any]:
    """Return the JSON Schema of one of the `VERSIONS` of marker.json."""
    schema = MarkerFile.model_json_schema()
    _without_newer(schema, version)
    schema["properties"]["version"] = {"const": version, "title": "Version", "type": "integer"}
    used = set[str]()
    _collect(schema["properties"], schema["$defs"], used)
    schema["$defs"] = {name: form for name, form in schema["$defs"].items() if name in used}
    return {"$schema": DIALECT, **schema}


def _without_newer(schema: Any, version: int) -> None:
    """Remove the keys added after a version, and the newer choices of forms."""
    newer = {f"#/$defs/{name}" for name, form in schema["$defs"].items() if form.get(SINCE, 1) > version}

    def clean(part: Any) -> None:
        if isinstance(part, dict):
            for key, value in list(part.get("properties", {}).items()):
                if value.get(SINCE, 1) > version:
                    del part["properties"][key]
            if "oneOf" in part:
                part["oneOf"] = [form for form in part["oneOf"] if form.get("$ref") not in newer]
        for item in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
            clean(item)

    clean(schema)


def _collect(schema: Any, forms: dict[str, Any], used: set[str]) -> None:
    """Collect the names of all forms that a schema refers to, directly or indirectly."""
    if isinstance(schema, list):
        for item in schema:
            _collect(item, forms, used)
    elif isinstance(schema, dict):
        name = str(schema.get("$ref", "")).rpartition("/")[2]
        if name and name not in used:
            used.add(name)
            _collect(forms[name], forms, used)
        for item in schema.values():
            _collect(item, forms, used)


TEXT: dict[str, Any] = {"type": "string"}
LENGTH: dict[str, Any] = {"type": ["number", "string"]}
SHAPE: dict[str, Any] = {"anyOf": [TEXT, {"$ref": "#/$defs/Boundary"}]}


def _rows_of(item: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of text or rows of items."""
    return {"anyOf": [TEXT, {"type": "array", "items": {"type": "array", "items": item}}]}


SCHEMAS: dict[str, dict[str, Any]] = {
    **{name: {"type": kind} for name, kind in (("int", "integer"), ("float", "number"), ("bool", "boolean"))},
    **dict.fromkeys(("str", "poses", "objective"), TEXT),
    **dict.fromkeys(("length", "length or auto", "length or fit"), LENGTH),
    "int or auto": {"anyOf": [{"type": "integer"}, {"const": "auto"}]},
    "texts": {"anyOf": [TEXT, {"type": "array", "items": TEXT}]},
    "shape": SHAPE,
    "shapes": {"type": "array", "items": SHAPE},
    "camera": {"anyOf": [TEXT, {"$ref": "#/$defs/Camera"}]},
    "covariance": _rows_of({"type": "number"}),
    "settings": {"anyOf": [TEXT, ImageNoiseTable.model_json_schema()]},
    "layout": _rows_of(LENGTH),
    "file": {},
}
"""JSON Schemas of kinds of values in a spec file, where lengths are meters or text with a unit."""


def spec_schema() -> dict[str, Any]:
    """Return the JSON Schema of a spec file, for TOML editors to check and complete."""
    options = {name: option for name, option in declared(DesignKeywords).items() if name not in OUTSIDE_SPEC}
    keys = {key: _described(option) for option in options.values() for key in (option.name, *option.aliases)}
    plate = {name: _described(option) for name, option in declared(PlateKeywords).items()}
    boundary, hole = _lengths_as_text([TypeAdapter(BoundaryFile).json_schema(), HoleFile.model_json_schema()])
    tables = {"Boundary": boundary, "Camera": CameraTable.model_json_schema()}
    definitions: dict[str, Any] = {}
    for name, table in tables.items():
        definitions |= table.pop("$defs", {})
        definitions[name] = table
    return {
        "$schema": DIALECT,
        "title": "Spec of a design",
        "description": "What markergen design is asked for; lengths are meters, or text with a unit such as 150mm.",
        "type": "object",
        "properties": {
            "title": {"type": "string", "description": "What it is for, in a line."},
            **keys,
            "substrate": {
                "type": "object",
                "description": "The plate: the same keys as outside of this table, and its holes one by one.",
                "properties": {**plate, "holes": {"type": "array", "items": hole}},
                "additionalProperties": False,
            },
        },
        "additionalProperties": False,
        "$defs": definitions,
    }


def _described(option: Option) -> dict[str, Any]:
    text = f"{option.help} Default: {option.shown}." if option.shown else option.help
    default = {} if option.default is None else {"default": option.default}
    return {**SCHEMAS[option.kind], "description": text, **default}


def _lengths_as_text(schema: Any) -> Any:
    """Return a schema in which every number may also be text with a unit, as in spec files."""
    if isinstance(schema, list):
        return [_lengths_as_text(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "number":
        return {**schema, "type": ["number", "string"]}
    return {key: _lengths_as_text(value) for key, value in schema.items()}


def reference() -> str:
    """Return every command's help, as the terminal shows it at 100 columns."""
    Help.whole = True
    group = typer.main.get_command(app)
    parts = ["# Command line\n\nGenerated by `make docs`; the same text is behind `--help-all`.\n"]
    context = group.make_context("markergen", ["templates"], max_content_width=100, terminal_width=100)
    for name, command in [("", group), *sorted(group.commands.items())]:  # type: ignore[attr-defined]
        title = f"markergen {name}".strip()
        sub = command.context_class(command, info_name=title, max_content_width=100, terminal_width=100)
        parts.append(f"## {title}\n\n```text\n{command.get_help(sub)}\n```\n")
    context.close()
    return "\n".join(parts)


def page_of_templates() -> str:
    """Return the page that shows every template: its description, its picture, sizes, and command."""
    parts = [TEMPLATES]
    for template in overview().templates:
        description = template_text(template.name).splitlines()[0].removeprefix("# ")
        [picture] = sorted((HERE / "images" / "templates").glob(f"{template.name}.*"))
        size = " x ".join(f"{1e3 * side:.4g}" for side in template.size)
        dots = f"{template.dots} dots" if template.dots else "as many dots as the distances need"
        near, far = (f"{distance:.2g}" for distance in template.distances)
        suffixes = {"relief-print": (".3mf", ".step"), "cube": (".pdf", ".step")}.get(template.name, (".pdf",))
        output = " -o ".join(template.name + suffix for suffix in suffixes)
        parts.append(
            f"## {template.name}\n\n{description}\n\n"
            f'<img src="images/templates/{picture.name}" width="260" alt="{template.title}, as designed">\n\n'
            f"{size} mm, {dots}, for {template.camera[0]}x{template.camera[1]} px from {near} to {far} m.\n\n"
            f"```sh\nmarkergen {template.command} --template {template.name} -o {output}\n```\n"
        )
    return "\n".join(parts)


def files() -> dict[str, str]:
    """Return the text of every file that is written, by its name."""
    schemas = {f"marker-v{version}": json_schema(version) for version in VERSIONS}
    schemas |= {"rig-v1": {"$schema": DIALECT, **RigFile.model_json_schema()}, "spec": spec_schema()}
    pages = {"cli.md": reference(), "templates.md": page_of_templates(), "damage.md": page_of_damage()}
    return {f"{name}.schema.json": json.dumps(schema, indent=2) + "\n" for name, schema in schemas.items()} | pages


if __name__ == "__main__":
    for file, text in files().items():
        (HERE / file).write_text(text)
