"""marker.json: written canonically, read back with every error and its path.

The file is the whole marker: frame, boundary, control points with features, and provenance. Its version is the lowest
one that has all its keys: a marker without keys of version 2 is written as version 1, for programs that read only that.
`marker_file.json_schema` returns the published schemas (docs/marker-v1.schema.json, docs/marker-v2.schema.json).
"""

import json
import os
from collections.abc import Mapping
from math import hypot
from typing import Any

from markergen.errors import InputError, brief
from markergen.guard import read
from markergen.model.json_text import dumped, json_of, parsed
from markergen.model.marker import ControlPoint, JointCovariance, Marker
from markergen.model.marker_file import FORMAT, checked_file, newer_keys
from markergen.model.tag import Tag

_FRAME = {"unit": "m", "x": "right", "y": "up", "z": "out of the printed face, toward the viewer"}
_CENTER, _DRAWING = "center of the boundary's smallest enclosing circle", "that of the boundary's drawing"

ROUNDING = 1e-9
"""Distance in m of a center from the origin that counts as none: the corners of drawings are rounded."""


def to_json(marker: Marker) -> bytes:
    """Return the marker as canonical JSON: the same marker gives the same bytes, and reading returns equal numbers.

    Raises
    ------
    InputError
        If the marker contains a number that is not finite, or its provenance or extensions are not plain JSON.
    """
    centered = hypot(*marker.boundary.center) <= ROUNDING
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


def from_content(content: Any, name: str) -> Marker:
    """Make a marker from the values of a marker.json; `name` is its name in messages. Raises as `read_marker` does."""
    form = checked_file(content, name)
    if form.plates:
        names = ", ".join(plate.name for plate in form.plates)
        raise InputError(f"a marker on one plate in {name}", f"plates: {names[:80]}", "load it with Rig.load")
    return form.build()
