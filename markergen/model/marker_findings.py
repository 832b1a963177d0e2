"""What is wrong with a marker.json beyond its form: dots, tags, plates and holes that contradict or hit one another.

Each check speaks of those parts that are well formed by themselves, whatever is wrong elsewhere in the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.boundary_file import BoundaryFile
from markergen.model.marker import Plate
from markergen.model.marker_file import (
    MOST_CONTROL_POINTS,
    MOST_PLATES,
    TOLERANCE,
    NonNegative,
    _ControlPoint,
    _JointCovariance,
    _Plate,
    _PrintCorrection,
    _Tag,
)
from markergen.model.substrate_checks import crowded, sunk
from markergen.model.substrate_file import SubstrateFile

Array = NDArray[np.float64]
Value = TypeVar("Value")
Borders = dict[str, tuple[Boundary, int]]
"""What dots must stay clear of, by name: a boundary (1) from inside, a keep-out (-1) from outside."""

POINT: TypeAdapter[_ControlPoint] = TypeAdapter(_ControlPoint)
CORRECTION: TypeAdapter[_PrintCorrection] = TypeAdapter(_PrintCorrection)
BOUNDARY: TypeAdapter[Any] = TypeAdapter(BoundaryFile)
TAG: TypeAdapter[_Tag] = TypeAdapter(_Tag)
SUBSTRATE: TypeAdapter[SubstrateFile] = TypeAdapter(SubstrateFile)
GAP: TypeAdapter[float] = TypeAdapter(Annotated[NonNegative, Field(strict=True)])
JOINT: TypeAdapter[_JointCovariance] = TypeAdapter(_JointCovariance)
PLATE: TypeAdapter[_Plate] = TypeAdapter(_Plate)


@dataclass(frozen=True)
class _Dots:
    """Dots of one plate where they were designed: paths in the file, places (n, 2) in the plate, and radii (n,), m."""

    paths: list[str]
    xy: Array
    radii: Array


def contradictions(content: Mapping[str, Any]) -> list[str]:
    """Findings about a file's content, each with its path."""
    items = content.get("control_points")
    if not isinstance(items, list) or len(items) > MOST_CONTROL_POINTS:
        return []
    points = {
        f"control_points[{index}]": point
        for index, item in enumerate(items)
        if (point := _valid(POINT, item)) is not None
    }
    tag = _valid(TAG, content.get("tag"))
    findings = _features(points) + (_tag_findings(tag, "tag") if tag else []) + _joint(content, points)
    clearance = _valid(GAP, content.get("clearance")) or 0.0
    # It is the design that keeps clear of things; a print may be larger, or its dots a little off.
    correction = _valid(CORRECTION, content.get("print_correction"))
    designed = np.array([_designed(point, correction) for point in points.values()]).reshape(-1, 3)
    if content.get("plates"):
        return findings + _plates(content, points, designed, clearance)
    dots = _dots(points, designed)
    if points:
        borders = _borders(content.get("boundary"), content.get("keep_outs"), tag)
        findings += _room(dots, borders, clearance) + _gaps(dots, clearance)
    return findings + _holes(content, dots, clearance, tag)


def _valid(kind: TypeAdapter[Value], value: object) -> Value | None:
    try:
        return kind.validate_python(value)
    except ValidationError:
        return None


def _designed(point: _ControlPoint, correction: _PrintCorrection | None) -> tuple[float, float, float]:
    scale = (correction.scale_x, correction.scale_y) if correction else (1.0, 1.0)
    x, y = point.designed or (point.x / scale[0], point.y / scale[1])
    return x, y, point.z if point.designed_z is None else point.designed_z


def _dots(points: Mapping[str, _ControlPoint], places: Array) -> _Dots:
    # Squares of larger coordinates would not be finite.
    xy = np.clip(places[:, :2], -1e100, 1e100)
    return _Dots(list(points), xy, np.array([point.feature.diameter / 2 for point in points.values()]))


def _borders(boundary: object, keep_outs: object, tag: _Tag | None, prefix: str = "") -> Borders:
    borders = {}
    if (outer := _valid(BOUNDARY, boundary)) is not None:
        borders[f"the boundary{' of ' + prefix if prefix else ''}"] = (outer.build(), 1)
    for index, item in enumerate(keep_outs if isinstance(keep_outs, list) else []):
        if (keep_out := _valid(BOUNDARY, item)) is not None:
            borders[f"{prefix + '.' if prefix else ''}keep_outs[{index}]"] = (keep_out.build(), -1)
    if tag is not None and not _tag_findings(tag, "tag"):
        borders["the quiet zone of the tag"] = (tag.build().quiet_zone, -1)
    return borders


def _tag_findings(file: _Tag, path: str) -> list[str]:
    """Findings about a tag that contradicts itself."""
    try:
        tag = file.build()
    except InputError as error:
        return [f"{path}.id: {error}"]
    found = []
    expected = np.column_stack([tag.corners, np.zeros(4)])
    if not np.allclose(file.corners, expected, rtol=0, atol=TOLERANCE):
        found.append(f"{path}.corners: not those of an upright square of side {tag.side} at z = 0, in the order stated")
    if abs(file.quiet_zone - tag.quiet) > TOLERANCE:
        found.append(f"{path}.quiet_zone: {file.quiet_zone}, and one cell of the tag is {tag.quiet}")
    return found


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


def _joint(content: Mapping[str, Any], points: Mapping[str, _ControlPoint]) -> list[str]:
    """Findings about a covariance of dots that there are not, or that have one of their own."""
    joint = _valid(JOINT, content.get("joint_covariance"))
    if joint is None:
        return []
    ids = {point.id for point in points.values()}
    findings = [
        f"joint_covariance.order[{index}]: no control point has the id {number}"
        for index, number in enumerate(joint.order)
        if number not in ids
    ]
    own = [path for path, point in points.items() if point.covariance is not None]
    return findings + [
        f"{path}.covariance: joint_covariance stands in its place, leave one of them out" for path in own
    ]


def _plates(
    content: Mapping[str, Any], points: dict[str, _ControlPoint], designed: Array, clearance: float
) -> list[str]:
    """Findings about a marker on several plates, each with its own boundary, keep-outs and tag."""
    findings = [f"{key}: each plate has its own, leave it out" for key in ("keep_outs", "tag") if content.get(key)]
    if content.get("print_correction"):
        findings.append("print_correction: a scale of one sheet, leave it out of a marker on several plates")
    substrate = content.get("substrate")
    for key in ("outline", "holes"):
        if isinstance(substrate, dict) and substrate.get(key):
            findings.append(f"substrate.{key}: of one plate alone, leave it out of a marker on several plates")
    items = content["plates"] if isinstance(content["plates"], list) else []
    plates = {f"plates[{i}]": plate for i, item in enumerate(items[:MOST_PLATES]) if (plate := _valid(PLATE, item))}
    paths = {point.id: path for path, point in points.items()}
    rows = dict(zip(points, designed, strict=True))
    names: set[str] = set()
    placed: set[int] = set()
    for path, file in plates.items():
        if file.name in names:
            findings.append(f"{path}.name: {file.name!r} is used twice")
        names.add(file.name)
        if file.tag:
            findings += _tag_findings(file.tag, f"{path}.tag")
        for index, number in enumerate(file.control_points):
            if number not in paths:
                findings.append(f"{path}.control_points[{index}]: no control point has the id {number}")
            elif number in placed:
                findings.append(f"{path}.control_points[{index}]: {number} is on a plate already")
            placed.add(number)
        here = {paths[number]: points[paths[number]] for number in file.control_points if number in paths}
        if here:
            places = _frame_of(file).to_plate(np.array([rows[each] for each in here]))
            dots = _dots(here, places)
            borders = _borders(file.boundary, None, file.tag, path)
            for index, keep_out in enumerate(file.keep_outs):
                borders[f"{path}.keep_outs[{index}]"] = (keep_out.build(), -1)
            findings += _room(dots, borders, clearance) + _gaps(dots, clearance)
    if len(plates) == len(items):
        findings += [f"{path}: on none of the plates" for path, point in points.items() if point.id not in placed]
    return findings


def _frame_of(file: _Plate) -> Plate:
    return file.model_copy(update={"tag": None}).build()


def _room(dots: _Dots, borders: Borders, clearance: float) -> list[str]:
    """Findings about dots that are over or near the boundary or a keep-out."""
    paths, findings = dots.paths, []
    for name, (border, side) in borders.items():
        inside = side * border.depth(dots.xy) - dots.radii
        for i in np.flatnonzero(inside < clearance - TOLERANCE):
            if inside[i] < -TOLERANCE:
                findings.append(f"{paths[i]}: stands {_mm(-inside[i])} over {name}")
            else:
                findings.append(f"{paths[i]}: {_mm(clearance - inside[i])} nearer to {name} than the clearance")
    return findings


def _gaps(dots: _Dots, clearance: float) -> list[str]:
    """Findings about dots that overlap or are near each other."""
    paths, findings = dots.paths, []
    gaps = np.linalg.norm(dots.xy[:, None] - dots.xy[None], axis=-1) - dots.radii[:, None] - dots.radii[None]
    for i, j in np.argwhere(np.triu(gaps < clearance - TOLERANCE, 1)):
        if gaps[i, j] < -TOLERANCE:
            findings.append(f"{paths[j]}: overlaps {paths[i]} by {_mm(-gaps[i, j])}")
        else:
            findings.append(f"{paths[j]}: {_mm(clearance - gaps[i, j])} nearer to {paths[i]} than the clearance")
    return findings


def _holes(content: Mapping[str, Any], dots: _Dots, clearance: float, tag: _Tag | None) -> list[str]:
    """Findings about holes of the plate that are over or near dots, the tag or each other, or sunk too deep."""
    file = _valid(SUBSTRATE, content.get("substrate"))
    if file is None or not file.holes:
        return []
    substrate = file.build()
    disks = {path: (x, y, r) for path, (x, y), r in zip(dots.paths, dots.xy.tolist(), dots.radii.tolist(), strict=True)}
    border = tag.build().quiet_zone if tag and not _tag_findings(tag, "tag") else None
    misfits = crowded(substrate.holes, disks, clearance, border) + sunk(substrate)
    return [f"substrate.holes[{misfit.hole}]: {misfit.found}" for misfit in misfits]


def _mm(meters: float) -> str:
    return f"{float(meters) * 1e3:.4g} mm"
