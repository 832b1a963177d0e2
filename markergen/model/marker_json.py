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
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, field_validator

from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.boundary_file import BoundaryFile, Finite, built
from markergen.model.feature import Feature
from markergen.model.findings import brief, findings_of, listed
from markergen.model.marker import ControlPoint, Marker
from markergen.model.substrate_checks import crowded, sunk
from markergen.model.substrate_file import SubstrateFile
from markergen.model.tag import FAMILIES, Tag

FORMAT, VERSION = "markergen-marker", 1
LARGEST_FILE, MOST_CONTROL_POINTS = 10_000_000, 1000
"""Bytes and control points; a marker has some kilobytes and a dozen points, a file beyond these is no marker."""
TOLERANCE = 1e-9
"""How far in m a dot may stand over the boundary, into another or into its clearance: rounding, far below printers."""

SMALLEST_SCALE, LARGEST_SCALE = 0.5, 2.0
"""Of a print; beyond these it is another marker."""

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
    covariance: Annotated[tuple[Finite, Finite, Finite], Field(strict=False)] | None = None
    designed: Annotated[tuple[Finite, Finite], Field(strict=False)] | None = None

    @field_validator("covariance")
    @classmethod
    def _is_one(cls, value: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if value and (min(value[0], value[2]) < 0 or abs(value[1]) > (1 + 1e-9) * (value[0] * value[2]) ** 0.5):
            raise ValueError("xx, xy, yy of no covariance: a variance is negative along some direction")
        return value


class _PrintCorrection(_Strict):
    """What the printer made of 1 along x and y: the control points are those of the print."""

    scale_x: Annotated[float, Field(ge=SMALLEST_SCALE, le=LARGEST_SCALE)]
    scale_y: Annotated[float, Field(ge=SMALLEST_SCALE, le=LARGEST_SCALE)]


class _Tag(_Strict):
    """A square tag at z = 0, upright in the marker frame; lengths in m."""

    family: Literal[tuple(FAMILIES)]  # type: ignore[valid-type]  # a table, not a list of words
    id: Annotated[int, Field(ge=0)]
    side: Annotated[float, Field(gt=0, allow_inf_nan=False, description="Of the black square.")]
    quiet_zone: Annotated[float, Field(gt=0, allow_inf_nan=False, description="Width of the white edge around it.")]
    corner_order: Literal["top left, top right, bottom right, bottom left"]
    corners: Annotated[
        list[Annotated[list[Finite], Field(min_length=3, max_length=3)]],
        Field(min_length=4, max_length=4, description="Of the black square, x y z in the marker frame."),
    ]

    def build(self) -> Tag:
        center = np.mean(self.corners, axis=0)
        # A center in the origin is not moved by rounding.
        x, y = (round(float(value), 12) + 0.0 for value in center[:2])
        return Tag(self.family, self.id, self.side, (x, y))

    def findings(self) -> list[str]:
        """What of it contradicts the rest."""
        try:
            tag = self.build()
        except InputError as error:
            return [f"tag.id: {error}"]
        found = []
        expected = np.column_stack([tag.corners, np.zeros(4)])
        if not np.allclose(self.corners, expected, rtol=0, atol=TOLERANCE):
            found.append(
                f"tag.corners: not those of an upright square of side {tag.side} at z = 0, in the order stated"
            )
        if abs(self.quiet_zone - tag.quiet) > TOLERANCE:
            found.append(f"tag.quiet_zone: {self.quiet_zone}, and one cell of the tag is {tag.quiet}")
        return found


class MarkerFile(_Strict):
    """A fiducial marker: lengths in m, marker frame x right, y up, z out of the printed face."""

    format: Literal["markergen-marker"]
    version: Literal[1]
    frame: _Frame
    boundary: BoundaryFile
    keep_outs: list[BoundaryFile] = []
    clearance: NonNegative
    control_points: Annotated[list[_ControlPoint], Field(min_length=4, max_length=MOST_CONTROL_POINTS)]
    tag: _Tag | None = None
    substrate: SubstrateFile
    print_correction: _PrintCorrection | None = None
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
                **({"covariance": list(point.covariance)} if point.covariance else {}),
                **({"designed": list(point.designed)} if point.designed else {}),
            }
            for point in marker.control_points
        ],
        "tag": _tag(marker.tag),
        "substrate": marker.substrate.as_dict(),
        "print_correction": None if marker.print_scale == (1.0, 1.0) else _correction(marker.print_scale),
        "provenance": dict(marker.provenance),
    }
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


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
CORRECTION: TypeAdapter[_PrintCorrection] = TypeAdapter(_PrintCorrection)
BOUNDARY: TypeAdapter[Any] = TypeAdapter(BoundaryFile)
TAG: TypeAdapter[_Tag] = TypeAdapter(_Tag)
SUBSTRATE: TypeAdapter[SubstrateFile] = TypeAdapter(SubstrateFile)
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
    tag = _valid(TAG, content.get("tag"))
    findings = _features(points) + (tag.findings() if tag else [])
    if points:
        # It is the design that keeps clear of things; a print may be larger, or its dots a little off.
        points = {
            path: _designed(point, _valid(CORRECTION, content.get("print_correction")))
            for path, point in points.items()
        }
        clearance = _valid(GAP, content.get("clearance")) or 0.0
        findings += _room(points, _borders(content), clearance) + _gaps(points, clearance)
    return findings + _holes(content, points)


def _holes(content: dict[str, Any], points: dict[str, _ControlPoint]) -> list[str]:
    """Findings about holes of the plate that are over or near dots, the tag or each other, or sunk too deep."""
    file, tag = _valid(SUBSTRATE, content.get("substrate")), _valid(TAG, content.get("tag"))
    if file is None or not file.holes:
        return []
    substrate = file.build()
    dots = {path: (p.x, p.y, p.feature.diameter / 2) for path, p in points.items()}
    clearance = _valid(GAP, content.get("clearance")) or 0.0
    border = tag.build().quiet_zone if tag and not tag.findings() else None
    misfits = crowded(substrate.holes, dots, clearance, border) + sunk(substrate)
    return [f"substrate.holes[{misfit.hole}]: {misfit.found}" for misfit in misfits]


def _designed(point: _ControlPoint, correction: _PrintCorrection | None) -> _ControlPoint:
    scale = (correction.scale_x, correction.scale_y) if correction else (1.0, 1.0)
    x, y = point.designed or (point.x / scale[0], point.y / scale[1])
    return point.model_copy(update={"x": x, "y": y})


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
    tag = _valid(TAG, content.get("tag"))
    if tag is not None and not tag.findings():
        borders["the quiet zone of the tag"] = (tag.build().quiet_zone, -1)
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
            ControlPoint(
                p.id, p.x, p.y, p.z, Feature(p.feature.diameter, p.feature.inner_diameter), p.covariance, p.designed
            )
            for p in file.control_points
        ),
        boundary=file.boundary.build(),
        clearance=file.clearance,
        substrate=file.substrate.build(),
        provenance=file.provenance,
        keep_outs=built(file.keep_outs),
        tag=file.tag.build() if file.tag else None,
        print_scale=(file.print_correction.scale_x, file.print_correction.scale_y) if file.print_correction else (1, 1),
    )
