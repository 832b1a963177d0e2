"""Requests name no files: an address that somebody shares must not read or write any on this computer."""

from collections.abc import Mapping
from typing import Any

from markergen.errors import InputError, brief
from markergen.model.poses import is_named
from markergen.options import as_list, declared
from markergen.read.layout import is_table
from markergen.read.outlines.boundary import is_drawing


def refuse_files(options: Mapping[str, Any], table: type) -> None:
    """Refuse options that name a file instead of having its content, and those of files to write.

    Raises
    ------
    InputError
        Naming the first such option.
    """
    for name, option in declared(table).items():
        value = options.get(name)
        if value is not None and _names_one(value, option.kind):
            raise _named(option.flag, value)
    plate = options.get("substrate")
    for name, value in (
        ("keep_outs", options.get("keep_outs")),
        ("substrate.outline", plate.get("outline") if isinstance(plate, Mapping) else None),
    ):
        if value is not None and _names_one(value, "shapes"):
            raise _named(name, value)


def refuse_named_plates(content: Mapping[str, Any]) -> None:
    """Refuse a rig.json whose markers are other files; raises InputError."""
    markers = content.get("markers")
    for each in markers if isinstance(markers, list) else ():
        if isinstance(each, Mapping) and each.get("file"):
            remedy = "write all into one with: markergen export rig.json -o whole.json"
            raise InputError("a rig.json with its markers inside", f"the file {brief(each['file'])}", remedy)


def _names_one(value: object, kind: str) -> bool:
    if kind in ("camera", "covariance"):
        return isinstance(value, str)
    if kind in ("shape", "shapes"):
        return any(isinstance(each, str) and each.strip() and is_drawing(each) for each in as_list(value))
    if kind == "poses":
        return isinstance(value, str) and not is_named(value)
    return kind == "files" or (kind == "layout" and is_table(value))


def _named(flag: str, value: object) -> InputError:
    remedy = "correct it, or open the file in the page, which takes its content along"
    return InputError(f"{flag} without a file, in the studio", brief(value), remedy)
