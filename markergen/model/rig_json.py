"""rig.json: markers, inline or as files beside it, each with its pose T_rig_marker (docs/rig-v1.schema.json)."""
# tests: tests/model/test_marker_file.py tests/model/test_marker_json.py

import json
import os
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError

from markergen.errors import InputError, brief
from markergen.guard import check_size, read
from markergen.model.body import Body, Plate
from markergen.model.findings import findings_of, in_one_line
from markergen.model.json_text import dumped, json_of, parsed
from markergen.model.marker import Marker
from markergen.model.marker_file import PoseFile, checked_file
from markergen.model.marker_json import from_content, from_json, load_marker, read_marker, to_json
from markergen.model.rig import MOST_MARKERS, Rig
from markergen.model.shape_file import STRICT, Finite

FORMAT, VERSION = "markergen-rig", 1

_FRAME = "that of the poses T_rig_marker: X_rig = R X_marker + t"


class _Part(BaseModel):
    model_config = STRICT


class _Frame(_Part):
    """Rig frame, spelled out for readers of the file without this program."""

    unit: Literal["m"] = "m"
    axes: Literal["that of the poses T_rig_marker: X_rig = R X_marker + t"] = _FRAME  # type: ignore[assignment]


class _RigMarker(_Part):
    """One marker: its marker.json inline, or its file, relative to the folder of the rig.json."""

    name: Annotated[str, Field(min_length=1, max_length=40)]
    T_rig_marker: PoseFile
    marker: Annotated[dict[str, Any] | None, Field(description="A whole marker.json.")] = None
    file: Annotated[str | None, Field(min_length=1, max_length=1000, description="Path of a marker.json.")] = None


class RigFile(_Part):
    """Markers with a known rigid relation; lengths in m."""

    format: Literal["markergen-rig"]
    version: Literal[1]
    frame: _Frame = _Frame()
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
    return isinstance(content, Mapping) and (content.get("format") == FORMAT or bool(content.get("plates")))


def rig_to_json(rig: Rig) -> bytes:
    """Return the rig as JSON with all markers inline; the same rig gives the same bytes.

    Raises
    ------
    InputError
        If it contains a number that is not finite, or its provenance or extensions are not plain JSON.
    """
    content = {
        "format": FORMAT,
        "version": VERSION,
        "frame": {"unit": "m", "axes": _FRAME},
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
    """Return a rig as rig.json, a marker as marker.json; see `rig_to_json` and `marker_json.to_json`."""
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
        raise InputError(f'"format": "{FORMAT}" in {name}', "another kind of file", "give what markergen rig wrote")
    if content.get("format") != FORMAT:
        return checked_file(content, name).build_rig()
    version = content.get("version")
    if type(version) is not int or version != VERSION:
        update = "update markergen" if isinstance(version, int) and version > VERSION else "make the rig again"
        raise InputError(f"rig.json version {VERSION} in {name}", f"version {brief(version)}", update)
    try:
        form = RigFile.model_validate(content)
    except ValidationError as error:
        raise InputError(f"a valid rig in {name}", in_one_line(findings_of(error)), "correct these places") from None
    findings, markers = list[str](), list[Plate]()
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


def rig_schema() -> dict[str, Any]:
    """Return the JSON Schema of rig.json; inline markers follow that of marker.json."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **RigFile.model_json_schema()}
