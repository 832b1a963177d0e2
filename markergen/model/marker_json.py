"""marker.json: written canonically, read back with every error and its path.

The file is the whole marker: frame, boundary, control points with features, and provenance. Its version is the lowest
one that has all its keys: a marker without keys of version 2 is written as version 1, for programs that read only that.
`json_schema` returns the published schemas (docs/marker-v1.schema.json, docs/marker-v2.schema.json).
"""

import json
import os
from collections import Counter
from collections.abc import Mapping
from math import hypot, isfinite
from pathlib import PurePath
from typing import Any

import numpy as np
from pydantic import ValidationError

from markergen.errors import InputError, brief
from markergen.guard import Content, read, text_of
from markergen.model.findings import findings_of, listed, path_of
from markergen.model.marker import ControlPoint, JointCovariance, Marker
from markergen.model.marker_file import (
    FORMAT,
    TOLERANCE,
    VERSIONS,
    MarkerFile,
    json_schema,
    known_keys,
    newer_keys,
)
from markergen.model.marker_findings import contradictions
from markergen.model.tag import Tag

__all__ = ["from_json", "json_schema", "load_marker", "read_marker", "to_json"]

_FRAME = {"unit": "m", "x": "right", "y": "up", "z": "out of the printed face, toward the viewer"}
_CENTER, _DRAWING = "center of the boundary's smallest enclosing circle", "that of the boundary's drawing"


def to_json(marker: Marker) -> bytes:
    """Return the marker as canonical JSON: the same marker gives the same bytes, and reading returns equal numbers.

    Raises
    ------
    InputError
        If the marker contains a number that is not finite, or its provenance or extensions are not plain JSON.
    """
    # A small tolerance: the corners of drawings are rounded.
    centered = hypot(*marker.boundary.center) <= TOLERANCE
    joint = marker.joint_covariance
    content = {
        "format": FORMAT,
        "version": 1,
        "frame": {**_FRAME, "origin": _CENTER if centered else _DRAWING},
        "boundary": marker.boundary.as_dict(),
        **({"keep_outs": [keep_out.as_dict() for keep_out in marker.keep_outs]} if marker.keep_outs else {}),
        "clearance": marker.clearance,
        "control_points": [_control_point(point) for point in marker.control_points],
        **({"joint_covariance": {"order": joint.order, "axes": joint.axes, "matrix": None}} if joint else {}),
        "tag": _tag(marker.tag),
        "substrate": marker.substrate.as_dict(),
        "print_correction": None if marker.print_scale == (1.0, 1.0) else _correction(marker.print_scale),
        **({"rulers": _given(x=marker.rulers[0], y=marker.rulers[1])} if marker.rulers else {}),
        "provenance": dict(marker.provenance),
        **({"extensions": dict(marker.extensions)} if marker.extensions else {}),
    }
    content["version"] = max((version for _, version in newer_keys(content)), default=1)
    text = dumped(content)
    return ((_with_matrix(text, joint) if joint else text) + "\n").encode()


def _control_point(point: ControlPoint) -> dict[str, Any]:
    feature, size = point.feature, point.measured
    return {
        "id": point.id,
        "x": point.x,
        "y": point.y,
        "z": point.z,
        "feature": {
            "kind": feature.kind,
            "diameter": feature.diameter,
            "inner_diameter": feature.inner_diameter,
            **({"polarity": feature.polarity} if feature.polarity != "dark" else {}),
        },
        **({"covariance": list(point.covariance)} if point.covariance else {}),
        **({"designed": list(point.designed)} if point.designed else {}),
        **({"designed_z": point.designed_z} if point.designed_z is not None else {}),
        **({"measured": _given(diameter=size.diameter, diameter_sigma=size.diameter_sigma)} if size else {}),
    }


def _given(**values: float | None) -> dict[str, float]:
    return {key: value for key, value in values.items() if value is not None}


def _correction(scale: tuple[float, float]) -> dict[str, float]:
    return {"scale_x": scale[0], "scale_y": scale[1]}


def _tag(tag: Tag | None) -> dict[str, Any] | None:
    if tag is None:
        return None
    return {
        "family": tag.family,
        "id": tag.id,
        "side": tag.side,
        "quiet_zone": tag.quiet,
        "corner_order": "top left, top right, bottom right, bottom left",
        "corners": [[x, y, 0.0] for x, y in tag.corners.tolist()],
    }


def _with_matrix(text: str, joint: JointCovariance) -> str:
    """Write the matrix with one row per line: one number per line would be unreadable, and half whitespace."""
    rows = ",\n".join(f"      {json.dumps(row)}" for row in joint.matrix)
    # No key at this depth before it is called matrix, and JSON strings contain no line breaks.
    return text.replace('\n    "matrix": null', f'\n    "matrix": [\n{rows}\n    ]', 1)


def dumped(content: Any, indent: int | None = 2) -> str:
    """Return plain JSON values as text; raises InputError for others, and for numbers that are not finite."""
    try:
        return json.dumps(content, indent=indent, allow_nan=False, default=_plain)
    except RecursionError:
        actual = "endless nesting"
    except (TypeError, ValueError) as error:
        actual = str(error)[:80]
    raise InputError("a marker of plain JSON values and finite numbers", actual, "correct it where it was made")


def _plain(value: object) -> Any:
    """Convert NumPy numbers and arrays to Python's."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} {brief(value)}")


def load_marker(source: object) -> Marker:
    """Read a marker from a path, an open file, or parsed JSON; see `Marker.load`."""
    if isinstance(source, str | os.PathLike):
        return read_marker(source)
    if isinstance(source, Mapping):
        # By way of text: non-JSON values are refused, and nothing is shared with the caller.
        return from_json(dumped(source, None), "the dict")
    if callable(getattr(source, "read", None)):
        return _read(source)
    raise InputError(
        "a path, an open file or a dict of marker.json",
        f"{type(source).__name__} {brief(source)}",
        "give Marker.load what markergen design wrote",
    )


def read_marker(path: str | os.PathLike[str]) -> Marker:
    """Read a marker.json.

    Raises
    ------
    InputError
        If the file cannot be read, is not a marker.json, has a version unknown to this program, or violates the schema
        or the marker's geometry; then the message lists the errors with their paths, at most 20.
    """
    return _read(path)


def _read(source: object) -> Marker:
    content = read(source, "marker")
    return from_content(json_of(content), content.name)


def from_json(text: str, name: str = "marker.json") -> Marker:
    """Parse the text of a marker.json; `name` is its name in messages. Raises as `read_marker` does."""
    return from_content(parsed(text, name), name)


def json_of(content: Content) -> Any:
    """Parse a file that should be a marker.json or rig.json; raises InputError, which names another kind of file."""
    name = content.name
    kind = PurePath(name).suffix[1:].upper()
    if kind not in ("", "JSON") and not content.data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise InputError(f"a marker.json at {name}", f"a {kind} file", "give the .json that was written with it")
    return parsed(text_of(content), name)


def from_content(content: Any, name: str) -> Marker:
    """Make a marker from the values of a marker.json; `name` is its name in messages. Raises as `read_marker` does."""
    form = checked(content, name)
    if form.plates:
        names = ", ".join(plate.name for plate in form.plates)
        raise InputError(f"a marker on one plate in {name}", f"plates: {names[:80]}", "load it with Rig.load")
    return form.build()


def checked(content: Any, name: str) -> MarkerFile:
    """Check the values of a marker.json; raises as `read_marker` does."""
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(
            f'"format": "{FORMAT}" in {name}', "another kind of file", "give a marker.json written by markergen design"
        )
    version = content.get("version")
    if type(version) is not int or version not in VERSIONS:  # 1.0 and True equal 1, too
        raise _other_version(content, name)
    form, findings = _checked(content, version)
    findings += [
        f"{path_of(place)}: a key of version {since}, in a file that says version {version}"
        for place, since in newer_keys(content)
        if since > version
    ]
    findings += contradictions(content, form)
    if form is None or findings:
        raise InputError(f"a valid marker in {name}", listed(findings), "correct these places")
    return form


def _other_version(content: Mapping[str, Any], name: str) -> InputError:
    version, expected = content.get("version"), f"marker.json version {' or '.join(map(str, VERSIONS))} in {name}"
    if type(version) is not int or version < VERSIONS[0]:
        return InputError(expected, f"version {brief(version)}", "design the marker again with this version")
    writer: Any = content.get("provenance")
    for key in ("versions", "markergen"):
        writer = writer.get(key) if isinstance(writer, Mapping) else None
    by = f"a newer markergen ({brief(writer)[1:-1]})" if isinstance(writer, str) else "a newer markergen"
    return InputError(expected, f"version {brief(version)}, written by {by}", "update markergen")


def parsed(text: str, name: str) -> Any:
    """Parse JSON with distinct keys and finite numbers; `name` is the file's name in messages. Raises InputError."""
    try:
        return json.loads(
            text, object_pairs_hook=_distinct, parse_constant=_number, parse_float=_number, parse_int=_integer
        )
    except json.JSONDecodeError as error:
        actual = f"line {error.lineno} column {error.colno}: {error.msg}"
    except RecursionError:
        actual = "endless nesting"
    except ValueError as error:
        actual = str(error)
    raise InputError(
        f"complete JSON in {name}", actual, "the file is cut off or damaged: design it again or restore it"
    )


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        (key, _), *_ = Counter(key for key, _ in pairs).most_common(1)
        raise ValueError(f"the key {brief(key)} twice in one object")
    return content


def _number(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"the number {text if len(text) < 20 else text[:17] + '...'}, which is not finite")
    return value


def _integer(text: str) -> int:
    _number(text)  # Python's own message for thousands of digits is different
    return int(text)


def _checked(content: dict[str, Any], version: int) -> tuple[MarkerFile | None, list[str]]:
    try:
        return MarkerFile.model_validate(content), []
    except ValidationError as error:
        return None, findings_of(error, lambda location: known_keys(location, version))
