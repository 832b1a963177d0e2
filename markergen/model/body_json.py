"""The files of bodies, written canonically, and read back with every error and its path: marker.json and rig.json.

A marker.json is the whole marker: frame, boundary, control points with features, and provenance. Its version is the
lowest one that has all its keys: a marker without keys of version 2 is written as version 1, for programs that read
only that. A rig.json has markers, inline or as files beside it, each with its pose T_rig_marker. The schemas are
published (docs/marker-v1.schema.json, docs/marker-v2.schema.json, docs/rig-v1.schema.json).
"""
# tests: tests/model/test_marker_file.py tests/model/test_body_json.py

import json
import os
from collections.abc import Mapping
from functools import partial
from hashlib import sha256
from math import hypot
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError

from markergen.errors import InputError, brief
from markergen.guard import check_size, read
from markergen.model.body import Body, Plate
from markergen.model.json_text import dumped, findings_of, in_one_line, json_of, parsed
from markergen.model.marker import ControlPoint, Marker
from markergen.model.marker_file import FORMAT, PoseFile, checked_file, known_keys, newer_keys
from markergen.model.rig import MOST_MARKERS, Rig
from markergen.model.shape_file import STRICT, Finite
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
    joint, (x, y) = marker.joint_covariance, marker.print_scale
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
        "print_correction": None if (x, y) == (1.0, 1.0) else {"scale_x": x, "scale_y": y},
        **({"rulers": _given(x=marker.rulers[0], y=marker.rulers[1])} if marker.rulers else {}),
        "provenance": dict(marker.provenance),
        **({"extensions": dict(marker.extensions)} if marker.extensions else {}),
    }
    content["version"] = max((version for _, version in newer_keys(content)), default=1)
    text = dumped(content)
    if joint:
        # One row per line: one number per line would be unreadable, and half whitespace. No key at this depth before
        # it is called matrix, and JSON strings contain no line breaks.
        rows = ",\n".join(f"      {json.dumps(row)}" for row in joint.matrix)
        text = text.replace('\n    "matrix": null', f'\n    "matrix": [\n{rows}\n    ]', 1)
    return (text + "\n").encode()


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


def load_marker(source: object) -> Marker:
    """Read a marker from a path, an open file, or parsed JSON; see `Marker.load`."""
    if isinstance(source, Mapping):
        # By way of text: non-JSON values are refused, and nothing is shared with the caller.
        return from_json(dumped(source, None), "the dict")
    if isinstance(source, str | os.PathLike) or callable(getattr(source, "read", None)):
        return read_marker(source)
    raise InputError(
        "a path, an open file or a dict of marker.json",
        f"{type(source).__name__} {brief(source)}",
        "give Marker.load what markergen design wrote",
    )


def read_marker(source: object) -> Marker:
    """Read a marker.json from a path or an open file.

    Raises
    ------
    InputError
        If the file cannot be read, is not a marker.json, has a version unknown to this program, or violates the schema
        or the marker's geometry; then the message lists the errors with their paths, at most 20.
    """
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


RIG_FORMAT, RIG_VERSION = "markergen-rig", 1

_RIG_FRAME = "that of the poses T_rig_marker: X_rig = R X_marker + t"


class _RigPart(BaseModel):
    model_config = STRICT


class _RigFrame(_RigPart):
    """Rig frame, spelled out for readers of the file without this program."""

    unit: Literal["m"] = "m"
    axes: Literal["that of the poses T_rig_marker: X_rig = R X_marker + t"] = _RIG_FRAME  # type: ignore[assignment]


class _RigMarker(_RigPart):
    """One marker: its marker.json inline, or its file, relative to the folder of the rig.json."""

    name: Annotated[str, Field(min_length=1, max_length=40)]
    T_rig_marker: PoseFile
    marker: Annotated[dict[str, Any] | None, Field(description="A whole marker.json.")] = None
    file: Annotated[str | None, Field(min_length=1, max_length=1000, description="Path of a marker.json.")] = None


class RigFile(_RigPart):
    """Markers with a known rigid relation; lengths in m."""

    format: Literal["markergen-rig"]
    version: Literal[1]
    frame: _RigFrame = _RigFrame()
    markers: Annotated[list[_RigMarker], Field(min_length=1, max_length=MOST_MARKERS)]
    relation_covariance: Annotated[
        list[list[Finite]] | None,
        Field(
            max_length=6 * MOST_MARKERS,
            description="6 k rows of the k poses' (w, dt) in rad and m, rig frame: R <- exp([w]x) R, t <- t + dt; "
            "null or missing: they are exact.",
        ),
    ] = None
    provenance: dict[str, Any] = {}
    extensions: Annotated[dict[str, Any], Field(description="Of other programs, by name; preserved.")] = {}


def is_rig(content: object) -> bool:
    """Return whether the content of a JSON file is a rig.json, or a marker.json on several plates."""
    return isinstance(content, Mapping) and (content.get("format") == RIG_FORMAT or bool(content.get("plates")))


def rig_to_json(rig: Rig) -> bytes:
    """Return the rig as JSON with all markers inline; the same rig gives the same bytes.

    Raises
    ------
    InputError
        If it contains a number that is not finite, or its provenance or extensions are not plain JSON.
    """
    content = {
        "format": RIG_FORMAT,
        "version": RIG_VERSION,
        "frame": {"unit": "m", "axes": _RIG_FRAME},
        "markers": [
            {
                "name": plate.name,
                "T_rig_marker": {"rotation": plate.rotation, "translation": plate.translation},
                "marker": json.loads(to_json(plate.marker)),
            }
            for plate in rig.markers
        ],
        **({"relation_covariance": rig.relation} if rig.relation else {}),
        "provenance": dict(rig.provenance),
        **({"extensions": dict(rig.extensions)} if rig.extensions else {}),
    }
    return (dumped(content) + "\n").encode()


def body_to_json(body: Body) -> bytes:
    """Return a rig as rig.json, a marker as marker.json; see `rig_to_json` and `to_json`."""
    return rig_to_json(body) if isinstance(body, Rig) else to_json(body.plates[0].marker)


def rig_name(rig: Rig) -> str:
    """Return ``markergen-rig-<hash>``, safe in file headers, XML and on paper; the hash is that of its rig.json."""
    return f"markergen-rig-{sha256(rig_to_json(rig)).hexdigest()[:16]}"


def load_rig(source: object) -> Rig:
    """Read a rig from a path, an open file, or parsed JSON; see `Rig.load`."""
    if isinstance(source, Rig):
        return source
    if isinstance(source, Mapping):
        return _built(parsed(dumped(source, None), "the dict"), "the dict", Path())
    if isinstance(source, str | os.PathLike) or callable(getattr(source, "read", None)):
        content = read(source, "rig")
        return _built(json_of(content), content.name, _folder(source))
    raise InputError(
        "a path, an open file or a dict of rig.json",
        f"{type(source).__name__} {brief(source)}",
        "give Rig.load what markergen rig wrote",
    )


def load_marker_or_rig(source: object) -> Marker | Rig:
    """Read a marker or a rig, whichever a path, an open file or parsed JSON holds; either is returned as it is.

    Raises
    ------
    InputError
        As `Rig.load` does for a rig, and `Marker.load` for anything else.
    """
    if isinstance(source, Marker | Rig):
        return source
    if isinstance(source, Mapping):
        return load_rig(source) if is_rig(source) else load_marker(source)
    if not (isinstance(source, str | os.PathLike) or callable(getattr(source, "read", None))):
        return load_marker(source)
    data = read(source, "marker or rig")
    content = json_of(data)
    if is_rig(content):
        return _built(content, data.name, _folder(source))
    check_size(data, "marker")
    return from_content(content, data.name)


def _folder(source: object) -> Path:
    """Folder in which the files are that a rig names."""
    return Path(source).parent if isinstance(source, str | os.PathLike) else Path()


def _built(content: Any, name: str, folder: Path) -> Rig:
    if not is_rig(content):
        raise InputError(f'"format": "{RIG_FORMAT}" in {name}', "another kind of file", "give what markergen rig wrote")
    if content.get("format") != RIG_FORMAT:
        return checked_file(content, name).build_rig()
    version = content.get("version")
    if type(version) is not int or version != RIG_VERSION:
        update = "update markergen" if isinstance(version, int) and version > RIG_VERSION else "make the rig again"
        raise InputError(f"rig.json version {RIG_VERSION} in {name}", f"version {brief(version)}", update)
    try:
        form = RigFile.model_validate(content)
    except ValidationError as error:
        findings = findings_of(error, partial(known_keys, root=RigFile))
        raise InputError(f"a valid rig in {name}", in_one_line(findings), "correct these places") from None
    findings, markers = [], list[Plate]()
    for k, entry in enumerate(form.markers):
        try:
            if (entry.marker is None) == (entry.file is None):
                raise InputError("a marker, or the file of one", "both or neither", "give one of them")
            marker = (
                read_marker(folder / entry.file) if entry.file else from_json(dumped(entry.marker, None), entry.name)
            )
            pose = entry.T_rig_marker
            markers.append(Plate(entry.name, marker, tuple(map(tuple, pose.rotation)), tuple(pose.translation)))
        except InputError as error:
            findings.append(f"markers[{k}]: {error}")
    if findings:
        raise InputError(f"a valid rig in {name}", in_one_line(findings), "correct these places")
    relation = None if form.relation_covariance is None else tuple(map(tuple, form.relation_covariance))
    return Rig(tuple(markers), relation, form.provenance, form.extensions)
