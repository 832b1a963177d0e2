"""marker.json, version 1: written canonically, read back with every error and its path.

The file is the whole marker: frame, boundary, control points with features, and provenance. `json_schema` is the
published schema (docs/marker-v1.schema.json).
"""

import json
from collections import Counter
from math import hypot, isfinite
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.boundary_file import BoundaryFile, Finite, built
from markergen.model.feature import Feature
from markergen.model.findings import brief, findings_of, listed
from markergen.model.marker import ControlPoint, Marker

FORMAT, VERSION = "markergen-marker", 1
LARGEST_FILE, MOST_CONTROL_POINTS = 10_000_000, 1000
"""Bytes and control points; a marker has some kilobytes and a dozen points, a file beyond these is no marker."""
TOLERANCE = 1e-9
"""How far in m a dot may stand over the boundary, into another or into its clearance: rounding, far below printers."""

Value = TypeVar("Value")
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Frame(_Strict):
    """Marker frame, spelled out for whoever reads the file without this program."""

    unit: Literal["m"] = "m"
    x: Literal["right"] = "right"
    y: Literal["up"] = "up"
    z: Literal["out of the printed face, toward the viewer"] = "out of the printed face, toward the viewer"
    origin: Literal["center of the boundary's smallest enclosing circle", "that of the boundary's drawing"] = (
        "center of the boundary's smallest enclosing circle"
    )


class _Feature(_Strict):
    kind: Literal["dot", "ring"]
    diameter: NonNegative
    inner_diameter: NonNegative = 0.0


class _ControlPoint(_Strict):
    id: Annotated[int, Field(ge=0, le=2**31 - 1)]
    x: Finite
    y: Finite
    z: Finite
    feature: _Feature


class _Substrate(_Strict):
    thickness: Annotated[float, Field(ge=1e-5, le=1.0)]


class MarkerFile(_Strict):
    """A fiducial marker: lengths in m, marker frame x right, y up, z out of the printed face."""

    format: Literal["markergen-marker"]
    version: Literal[1]
    frame: _Frame
    boundary: BoundaryFile
    keep_outs: list[BoundaryFile] = []
    clearance: NonNegative
    control_points: Annotated[list[_ControlPoint], Field(min_length=4, max_length=MOST_CONTROL_POINTS)]
    tag: None = None
    substrate: _Substrate
    print_correction: None = None
    provenance: dict[str, Any]


def json_schema() -> dict[str, Any]:
    """JSON Schema of marker.json version 1."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **MarkerFile.model_json_schema()}


def to_json(marker: Marker) -> bytes:
    """Marker as canonical JSON text: the same marker gives the same bytes, and reading gives equal numbers back."""
    # A hair is forgiven: drawings have their corners rounded.
    centered = hypot(*marker.boundary.center) <= TOLERANCE
    frame = _Frame() if centered else _Frame(origin="that of the boundary's drawing")
    content = {
        "format": FORMAT,
        "version": VERSION,
        "frame": frame.model_dump(),
        "boundary": marker.boundary.as_dict(),
        **({"keep_outs": [keep_out.as_dict() for keep_out in marker.keep_outs]} if marker.keep_outs else {}),
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
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def read_marker(path: Path) -> Marker:
    """Read a marker.json.

    Raises
    ------
    InputError
        If the file cannot be read, is not a marker.json, has a version this program does not know, or breaks the
        schema or the marker's geometry; then *all* errors are told with their paths, of many the first 20.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
        if len(data) > LARGEST_FILE:
            raise InputError(
                f"a marker.json of at most {LARGEST_FILE // 10**6} MB at {path}", "a larger file", "check the path"
            )
        text = data.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "bytes that are not UTF-8 text"
        raise InputError(f"a readable marker.json at {path}", str(reason), "check the path") from None
    return from_json(text, str(path))


def from_json(text: str, name: str = "marker.json") -> Marker:
    """Parse the text of a marker.json; `name` is what messages call it. Raises as `read_marker` does."""
    content = _parse(text, name)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(
            f'"format": "{FORMAT}" in {name}', "another kind of file", "give a marker.json written by markergen design"
        )
    version = content.get("version")
    if type(version) is not int or version != VERSION:  # 1.0 and true equal 1, too
        raise InputError(
            f"marker.json version {VERSION} in {name}",
            f"version {brief(version)}",
            "update markergen, or design the marker again with this version",
        )
    findings = _structure(content) + _geometry(content)
    if findings:
        raise InputError(f"a valid marker in {name}", listed(findings), "correct these places")
    return _build(MarkerFile.model_validate(content))


def _parse(text: str, name: str) -> Any:
    try:
        return json.loads(
            text, object_pairs_hook=_distinct, parse_constant=_number, parse_float=_number, parse_int=_integer
        )
    except json.JSONDecodeError as error:
        found = f"line {error.lineno} column {error.colno}: {error.msg}"
    except RecursionError:
        found = "endless nesting"
    except ValueError as error:
        found = str(error)
    raise InputError(f"complete JSON in {name}", found, "the file is cut off or damaged: design it again or restore it")


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
    _number(text)  # Python refuses thousands of digits with words of its own
    return int(text)


def _structure(content: dict[str, Any]) -> list[str]:
    try:
        MarkerFile.model_validate(content)
    except ValidationError as error:
        return findings_of(error)
    return []


POINT: TypeAdapter[_ControlPoint] = TypeAdapter(_ControlPoint)
BOUNDARY: TypeAdapter[Any] = TypeAdapter(BoundaryFile)
GAP: TypeAdapter[float] = TypeAdapter(Annotated[NonNegative, Field(strict=True)])


def _valid(kind: TypeAdapter[Value], value: object) -> Value | None:
    try:
        return kind.validate_python(value)
    except ValidationError:
        return None


def _geometry(content: dict[str, Any]) -> list[str]:
    """Findings about the points that are well formed by themselves, whatever is wrong elsewhere in the file."""
    items = content.get("control_points")
    if not isinstance(items, list) or len(items) > MOST_CONTROL_POINTS:
        return []
    points = {
        f"control_points[{index}]": point
        for index, item in enumerate(items)
        if (point := _valid(POINT, item)) is not None
    }
    findings = _features(points)
    if points:
        clearance = _valid(GAP, content.get("clearance")) or 0.0
        findings += _room(points, _borders(content), clearance) + _gaps(points, clearance)
    return findings


def _borders(content: dict[str, Any]) -> dict[str, tuple[Boundary, int]]:
    """What dots must stay clear of, by name: the boundary (1) from inside and the keep-outs (-1) from outside."""
    borders = {}
    boundary = _valid(BOUNDARY, content.get("boundary"))
    if boundary is not None:
        borders["the boundary"] = (boundary.build(), 1)
    keep_outs = content.get("keep_outs")
    for index, item in enumerate(keep_outs if isinstance(keep_outs, list) else []):
        if (keep_out := _valid(BOUNDARY, item)) is not None:
            borders[f"keep_outs[{index}]"] = (keep_out.build(), -1)
    return borders


def _features(points: dict[str, _ControlPoint]) -> list[str]:
    findings = []
    seen: set[int] = set()
    for path, point in points.items():
        feature = point.feature
        if point.id in seen:
            findings.append(f"{path}.id: {point.id} is used twice")
        seen.add(point.id)
        if feature.inner_diameter and feature.inner_diameter >= feature.diameter:
            findings.append(
                f"{path}.feature.inner_diameter: not below the diameter of {feature.diameter} "
                f"(got {feature.inner_diameter})"
            )
        if (feature.kind == "ring") != (feature.inner_diameter > 0):
            findings.append(
                f"{path}.feature.kind: a ring has an inner_diameter above 0, a dot has none "
                f"(got {feature.kind!r} with {feature.inner_diameter})"
            )
    return findings


def _room(points: dict[str, _ControlPoint], borders: dict[str, tuple[Boundary, int]], clearance: float) -> list[str]:
    """Findings about dots that are over or near the boundary or a keep-out."""
    paths = list(points)
    # Squares of larger coordinates would not be finite.
    xy = np.clip([[point.x, point.y] for point in points.values()], -1e100, 1e100)
    radii = np.array([point.feature.diameter / 2 for point in points.values()])
    findings = []
    for name, (border, side) in borders.items():
        inside = side * border.depth(xy) - radii
        for i in np.flatnonzero(inside < clearance - TOLERANCE):
            if inside[i] < -TOLERANCE:
                findings.append(f"{paths[i]}: stands {_mm(-inside[i])} over {name}")
            else:
                findings.append(f"{paths[i]}: {_mm(clearance - inside[i])} nearer to {name} than the clearance")
    return findings


def _gaps(points: dict[str, _ControlPoint], clearance: float) -> list[str]:
    """Findings about dots that overlap or are near each other."""
    paths = list(points)
    xy = np.array([[point.x, point.y] for point in points.values()], dtype=float)
    radii = np.array([point.feature.diameter / 2 for point in points.values()])
    # Points so far out that this is not finite are far from each other, too, or the same.
    with np.errstate(over="ignore"):
        gaps = np.linalg.norm(xy[:, None] - xy[None], axis=-1) - radii[:, None] - radii[None]
    findings = []
    for i, j in np.argwhere(np.triu(gaps < clearance - TOLERANCE, 1)):
        if gaps[i, j] < -TOLERANCE:
            findings.append(f"{paths[j]}: overlaps {paths[i]} by {_mm(-gaps[i, j])}")
        else:
            findings.append(f"{paths[j]}: {_mm(clearance - gaps[i, j])} nearer to {paths[i]} than the clearance")
    return findings


def _mm(meters: float) -> str:
    return f"{float(meters) * 1e3:.4g} mm"


def _build(file: MarkerFile) -> Marker:
    return Marker(
        control_points=tuple(
            ControlPoint(p.id, p.x, p.y, p.z, Feature(p.feature.diameter, p.feature.inner_diameter))
            for p in file.control_points
        ),
        boundary=file.boundary.build(),
        clearance=file.clearance,
        thickness=file.substrate.thickness,
        provenance=file.provenance,
        keep_outs=built(file.keep_outs),
    )
