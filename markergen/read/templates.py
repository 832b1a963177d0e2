"""Ready-made specs: shipped templates, and the user's own TOML files."""

# tests: tests/api/test_templates.py

from pathlib import Path
from typing import Any

from markergen.errors import InputError, among
from markergen.files import shipped_folder
from markergen.guard import read, text_of
from markergen.model.json_text import parsed_toml
from markergen.options import declared
from markergen.options.declarations import DesignKeywords
from markergen.options.rig import RigKeywords

OTHERS = ("title", "shape", "substrate", "study", "grid", "keep_outs", "tag_side")
"""Keys of specs besides the options of `design` and `rig`."""


def read_template(name: str) -> dict[str, Any]:
    """Read the values of a template: the name of a shipped one (see `shipped_templates`), or the path of a TOML file.

    Raises InputError if there is no such template or the file is not TOML.
    """
    values = parsed_toml(template_text(name), name)
    # What is no spec is not quoted.
    if values and values.keys().isdisjoint({*OTHERS, *declared(DesignKeywords), *declared(RigKeywords)}):
        raise InputError(f"a spec in {name}", "none of its keys", "check the path; markergen templates shows specs")
    return values


def template_text(name: str) -> str:
    """Return the text of a template, found like `read_template`, including comments."""
    names = shipped_templates()
    path = Path(name)
    if path.suffix != ".toml" and name not in names:
        raise InputError("a known template or a .toml file", repr(name), among(name, names))
    return text_of(read(names.get(name, path), "spec"))


def shipped_templates() -> dict[str, Path]:
    """Return the shipped templates by name, from a wheel or a checkout."""
    return {path.stem: path for path in sorted(shipped_folder("templates").glob("*.toml"))}
