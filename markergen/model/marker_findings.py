"""Contradictions and collisions of dots, tags, plates and holes in a marker.json whose parts are well formed.

Each check uses the parts that are well formed by themselves, whatever is wrong elsewhere in the file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.marker_file import (
    MOST_CONTROL_POINTS,
    MOST_PLATES,
    TOLERANCE,
    MarkerFile,
    NonNegative,
    _ControlPoint,
    _JointCovariance,
    _Plate,
    _PrintCorrection,
    _Tag,
)
from markergen.model.shape_file import BoundaryFile, SubstrateFile
from markergen.model.substrate_checks import crowded, sunk

Array = NDArray[np.float64]
Value = TypeVar("Value")
Borders = dict[str, tuple[Boundary, int]]
"""Limits for dots, by name: a boundary (1) from inside, a keep-out (-1) from outside."""

HIGHEST = 100.0
"""Maximum distance in m of a dot from the plane z = 0, as of the sizes of boundaries."""


@dataclass(frozen=True)
class _Parts:
    """Well-formed parts of a file: control points, keep-outs and plates by their paths, None for malformed parts.

    `complete` is false if a plate is missing.
    """

    points: Mapping[str, _ControlPoint]
    clearance: float
    boundary: BoundaryFile | None
    keep_outs: Mapping[str, BoundaryFile]
    tag: _Tag | None
    substrate: SubstrateFile | None
    correction: _PrintCorrection | None
    joint: _JointCovariance | None
    plates: Mapping[str, _Plate]
    complete: bool = True


@dataclass(frozen=True)
class _Dots:
    """Dots of one plate as designed: paths in the file, places (n, 2) in the plate, and radii (n,), m."""

    paths: list[str]
    xy: Array
    radii: Array


def contradictions(content: Mapping[str, Any], form: MarkerFile | None) -> list[str]:
    """Return findings about a file's content, each with its path; `form` is the parsed file, None if it is damaged."""
    items = content.get("control_points")
    if form is None and (not isinstance(items, list) or len(items) > MOST_CONTROL_POINTS):
        return []
    parts = _usable(content) if form is None else _all(form)
    findings = _features(parts.points) + (_tag_findings(parts.tag, "tag") if parts.tag else []) + _joint(parts)
    # Only the design must keep clear of everything; a print may be larger, or its dots slightly off.
    designed = np.array([_designed(point, parts.correction) for point in parts.points.values()]).reshape(-1, 3)
    if content.get("plates"):
        return findings + _plates(parts, designed)
    dots = _dots(parts.points, designed)
    if parts.points:
        borders = _borders(parts.boundary, parts.keep_outs, parts.tag)
        findings += _room(dots, borders, parts.clearance) + _gaps(dots, parts.clearance)
    return findings + _holes(parts, dots)


def _all(form: MarkerFile) -> _Parts:
    return _Parts(
        _numbered("control_points", form.control_points),
        form.clearance,
        form.boundary,
        _numbered("keep_outs", form.keep_outs),
        form.tag,
        form.substrate,
        form.print_correction,
        form.joint_covariance,
        _numbered("plates", form.plates),
    )


def _usable(content: Mapping[str, Any]) -> _Parts:
    def usable(key: str, kind: Any, most: int | None = None) -> dict[str, Any]:
        items = content.get(key)
        values = [_valid(kind, item) for item in items[:most]] if isinstance(items, list) else []
        return {path: value for path, value in _numbered(key, values).items() if value is not None}

    plates = usable("plates", _Plate, MOST_PLATES)
    return _Parts(
        usable("control_points", _ControlPoint),
        _valid(Annotated[NonNegative, Field(strict=True)], content.get("clearance")) or 0.0,
        _valid(BoundaryFile, content.get("boundary")),
        usable("keep_outs", BoundaryFile),
        _valid(_Tag, content.get("tag")),
        _valid(SubstrateFile, content.get("substrate")),
        _valid(_PrintCorrection, content.get("print_correction")),
        _valid(_JointCovariance, content.get("joint_covariance")),
        plates,
        isinstance(content.get("plates"), list) and len(plates) == len(content["plates"]),
    )


def _numbered(key: str, items: Sequence[Value]) -> dict[str, Value]:
    return {f"{key}[{index}]": item for index, item in enumerate(items)}


def _valid(kind: Any, value: object) -> Any:
    try:
        return _adapter(kind).validate_python(value)
    except ValidationError:
        return None


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _designed(point: _ControlPoint, correction: _PrintCorrection | None) -> tuple[float, float, float]:
    scale = (correction.scale_x, correction.scale_y) if correction else (1.0, 1.0)
    x, y = point.designed or (point.x / scale[0], point.y / scale[1])
    return x, y, point.z if point.designed_z is None else point.designed_z


def _dots(points: Mapping[str, _ControlPoint], places: Array) -> _Dots:
    # Squares of larger coordinates would not be finite.
    xy = np.clip(places[:, :2], -1e100, 1e100)
    return _Dots(list(points), xy, np.array([point.feature.diameter / 2 for point in points.values()]))


def _borders(boundary: BoundaryFile | None, keep_outs: Mapping[str, BoundaryFile], tag: _Tag | None) -> Borders:
    borders = {"the boundary": (boundary.build(), 1)} if boundary is not None else {}
    borders |= {path: (keep_out.build(), -1) for path, keep_out in keep_outs.items()}
    if tag is not None and not _tag_findings(tag, "tag"):
        borders["the quiet zone of the tag"] = (tag.build().quiet_zone, -1)
    return borders


def _tag_findings(file: _Tag, path: str) -> list[str]:
    """Return findings about a tag that contradicts itself."""
    try:
        tag = file.build()
    except InputError as error:
        return [f"{path}.id: {error}"]
    findings = []
    expected = np.column_stack([tag.corners, np.zeros(4)])
    if not np.allclose(file.corners, expected, rtol=0, atol=TOLERANCE):
        findings.append(
            f"{path}.corners: not those of an upright square of side {tag.side} at z = 0, in the order stated"
        )
    if abs(file.quiet_zone - tag.quiet) > TOLERANCE:
        findings.append(f"{path}.quiet_zone: {file.quiet_zone}, and one cell of the tag is {tag.quiet}")
    return findings


def _features(points: Mapping[str, _ControlPoint]) -> list[str]:
    findings = []
    seen: set[int] = set()
    for path, point in points.items():
        feature = point.feature
        if point.id in seen:
            findings.append(f"{path}.id: {point.id} is used twice")
        seen.add(point.id)
        if abs(point.z) > HIGHEST:
            findings.append(f"{path}.z: {point.z:g} m, and heights are at most {HIGHEST:g} m")
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


def _joint(parts: _Parts) -> list[str]:
    """Return findings about a covariance of missing dots, or of dots that have their own."""
    if parts.joint is None:
        return []
    ids = {point.id for point in parts.points.values()}
    findings = [
        f"joint_covariance.order[{index}]: no control point has the id {number}"
        for index, number in enumerate(parts.joint.order)
        if number not in ids
    ]
    single = [path for path, point in parts.points.items() if point.covariance is not None]
    return findings + [f"{path}.covariance: joint_covariance stands in its place: leave one out" for path in single]


def _plates(parts: _Parts, designed: Array) -> list[str]:
    """Return findings about a marker on several plates, each with its own boundary, keep-outs and tag."""
    substrate = parts.substrate
    for_one = {
        "keep_outs": parts.keep_outs,
        "tag": parts.tag,
        "print_correction": parts.correction,
        "substrate.outline": substrate and substrate.outline,
        "substrate.holes": substrate and substrate.holes,
    }
    findings = [
        f"{path}: of a marker on one plate; leave it out, or leave out plates" for path in for_one if for_one[path]
    ]
    paths = {point.id: path for path, point in parts.points.items()}
    rows = dict(zip(parts.points, designed, strict=True))
    names: set[str] = set()
    placed: set[int] = set()
    for path, file in parts.plates.items():
        if file.name in names:
            findings.append(f"{path}.name: {file.name!r} is used twice")
        names.add(file.name)
        findings += _tag_findings(file.tag, f"{path}.tag") if file.tag else []
        for index, number in enumerate(file.control_points):
            if number not in paths:
                findings.append(f"{path}.control_points[{index}]: no control point has the id {number}")
            elif number in placed:
                findings.append(f"{path}.control_points[{index}]: {number} is on a plate already")
            placed.add(number)
        here = {paths[number]: parts.points[paths[number]] for number in file.control_points if number in paths}
        if here:
            rotation, translation = np.array(file.pose.rotation), np.array(file.pose.translation)
            dots = _dots(here, (np.array([rows[path] for path in here]) - translation) @ rotation)
            borders = _borders(file.boundary, _numbered("keep_outs", file.keep_outs), file.tag)
            borders = {f"{name} of {path}": border for name, border in borders.items()}
            findings += _room(dots, borders, parts.clearance) + _gaps(dots, parts.clearance)
    if parts.complete:
        findings += [f"{path}: on none of the plates" for path, point in parts.points.items() if point.id not in placed]
    return findings


def _room(dots: _Dots, borders: Borders, clearance: float) -> list[str]:
    """Return findings about dots that cross or are near the boundary or a keep-out."""
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
    """Return findings about dots that overlap or are near each other."""
    paths, findings = dots.paths, []
    gaps = np.linalg.norm(dots.xy[:, None] - dots.xy[None], axis=-1) - dots.radii[:, None] - dots.radii[None]
    for i, j in np.argwhere(np.triu(gaps < clearance - TOLERANCE, 1)):
        if gaps[i, j] < -TOLERANCE:
            findings.append(f"{paths[j]}: overlaps {paths[i]} by {_mm(-gaps[i, j])}")
        else:
            findings.append(f"{paths[j]}: {_mm(clearance - gaps[i, j])} nearer to {paths[i]} than the clearance")
    return findings


def _holes(parts: _Parts, dots: _Dots) -> list[str]:
    """Return findings about holes that hit or are near dots, the tag or each other, or are countersunk too deep."""
    if parts.substrate is None or not parts.substrate.holes:
        return []
    substrate = parts.substrate.build()
    disks = {path: (x, y, r) for path, (x, y), r in zip(dots.paths, dots.xy.tolist(), dots.radii.tolist(), strict=True)}
    border = parts.tag.build().quiet_zone if parts.tag and not _tag_findings(parts.tag, "tag") else None
    misfits = crowded(substrate.holes, disks, parts.clearance, border) + sunk(substrate)
    return [f"substrate.holes[{misfit.hole}]: {misfit.problem}" for misfit in misfits]


def _mm(meters: float) -> str:
    return f"{float(meters) * 1e3:.4g} mm"
