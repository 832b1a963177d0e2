"""marker.json, version 1: written canonically, read back with every error and its path.

The file is the whole marker: frame, boundary, control points with features, and provenance. `json_schema` is the
published schema (docs/marker-v1.schema.json).
"""

import json
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker

FORMAT, VERSION = "markergen-marker", 1
TOLERANCE = 1e-9
"""How far in m a dot may stand over the boundary or into another: rounding, far below any printer."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Frame(_Strict):
    """Marker frame, spelled out for whoever reads the file without this program."""

    unit: Literal["m"] = "m"
    x: Literal["right"] = "right"
    y: Literal["up"] = "up"
    z: Literal["out of the printed face, toward the viewer"] = "out of the printed face, toward the viewer"
    origin: Literal["center of the boundary's smallest enclosing circle"] = (
        "center of the boundary's smallest enclosing circle"
    )


class _Circle(_Strict):
    kind: Literal["circle"]
    radius: Positive


class _Feature(_Strict):
    kind: Literal["dot", "ring"]
    diameter: NonNegative
    inner_diameter: NonNegative = 0.0


class _ControlPoint(_Strict):
    id: Annotated[int, Field(ge=0)]
    x: Finite
    y: Finite
    z: Finite
    feature: _Feature


class _Substrate(_Strict):
    thickness: Positive


class MarkerFile(_Strict):
    """A fiducial marker: lengths in m, marker frame x right, y up, z out of the printed face."""

    format: Literal["markergen-marker"]
    version: Literal[1]
    frame: _Frame
    boundary: _Circle
    clearance: NonNegative
    control_points: Annotated[list[_ControlPoint], Field(min_length=4)]
    tag: None = None
    substrate: _Substrate
    print_correction: None = None
    provenance: dict[str, Any]


def json_schema() -> dict[str, Any]:
    """JSON Schema of marker.json version 1."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **MarkerFile.model_json_schema()}


def to_json(marker: Marker) -> bytes:
    """Marker as canonical JSON text: the same marker gives the same bytes, and reading gives equal numbers back."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "frame": _Frame().model_dump(),
        "boundary": marker.boundary.as_dict(),
        "clearance": marker.clearance,
        "control_points": [
            {
                "id": point.id,
                "x": point.x,
                "y": point.y,
                "z": point.z,
                "feature": {
                    "kind": point.feature.kind,
                    "diameter": point.feature.diameter,
                    "inner_diameter": point.feature.inner_diameter,
                },
            }
            for point in marker.control_points
        ],
        "tag": None,
        "substrate": {"thickness": marker.thickness},
        "print_correction": None,
        "provenance": dict(marker.provenance),
    }
    return (json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def read_marker(path: Path) -> Marker:
    """Read a marker.json.

    Raises
    ------
    InputError
        If the file cannot be read, is not a marker.json, has a version this program does not know, or breaks the
        schema or the marker's geometry; then *all* errors are listed, each with its path.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "bytes that are not UTF-8 text"
        raise InputError(f"a readable marker.json at {path}", str(reason), "check the path") from None
    return from_json(text, str(path))


def from_json(text: str, name: str = "marker.json") -> Marker:
    """Parse the text of a marker.json; `name` is what messages call it. Raises as `read_marker` does."""
    try:
        content = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        where = (
            f"line {error.lineno} column {error.colno}: {error.msg}"
            if isinstance(error, json.JSONDecodeError)
            else "endless nesting"
        )
        raise InputError(
            f"complete JSON in {name}", where, "the file is cut off or damaged: design it again or restore it"
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(
            f'"format": "{FORMAT}" in {name}', "another kind of file", "give a marker.json written by markergen design"
        )
    if content.get("version") != VERSION:
        raise InputError(
            f"marker.json version {VERSION} in {name}",
            f"version {content.get('version')!r}",
            "update markergen, or design the marker again with this version",
        )
    findings = _structure(content) + _geometry(content)
    if findings:
        raise InputError(f"a valid marker in {name}", "; ".join(findings), "correct these places")
    return _build(MarkerFile.model_validate(content))


def _structure(content: dict[str, Any]) -> list[str]:
    try:
        MarkerFile.model_validate(content)
    except ValidationError as error:
        return [f"{_path(item['loc'])}: {item['msg']} (got {_brief(item['input'])})" for item in error.errors()]
    return []


def _geometry(content: dict[str, Any]) -> list[str]:
    """Findings about the points that are well formed by themselves, whatever is wrong elsewhere in the file."""
    points: list[tuple[int, _ControlPoint]] = []
    listed = content.get("control_points")
    for index, item in enumerate(listed if isinstance(listed, list) else []):
        try:
            points.append((index, _ControlPoint.model_validate(item)))
        except ValidationError:
            continue
    findings = []
    counts = Counter(point.id for _, point in points)
    seen: set[int] = set()
    for index, point in points:
        if counts[point.id] > 1 and point.id in seen:
            findings.append(f"control_points[{index}].id: {point.id} is used twice")
        seen.add(point.id)
        if not 0 <= point.feature.inner_diameter <= point.feature.diameter:
            findings.append(f"control_points[{index}].feature.inner_diameter: not below the diameter")
    try:
        boundary = Circle(_Circle.model_validate(content.get("boundary")).radius)
    except ValidationError:
        return findings
    if not points:
        return findings
    xy = np.array([[point.x, point.y] for _, point in points])
    radii = np.array([point.feature.diameter / 2 for _, point in points])
    outside = radii - boundary.depth(xy)
    findings += [
        f"control_points[{index}]: stands {over * 1e3:.4g} mm over the boundary"
        for (index, _), over in zip(points, outside, strict=True)
        if over > TOLERANCE
    ]
    gaps = np.linalg.norm(xy[:, None] - xy[None], axis=-1) - radii[:, None] - radii[None]
    findings += [
        f"control_points[{points[j][0]}]: overlaps control_points[{points[i][0]}] by {-gaps[i, j] * 1e3:.4g} mm"
        for i, j in zip(*np.triu_indices(len(points), 1), strict=True)
        if gaps[i, j] < -TOLERANCE
    ]
    return findings


def _build(file: MarkerFile) -> Marker:
    return Marker(
        control_points=tuple(
            ControlPoint(p.id, p.x, p.y, p.z, Feature(p.feature.diameter, p.feature.inner_diameter))
            for p in file.control_points
        ),
        boundary=Circle(file.boundary.radius),
        clearance=file.clearance,
        thickness=file.substrate.thickness,
        provenance=file.provenance,
    )


def _path(location: tuple[int | str, ...]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".") or "file"


def _brief(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
