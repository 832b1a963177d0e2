"""Form of marker.json, versions 1 and 2: keys, types, constraints on values, and what they contradict (`checked_file`).

One set of forms serves all versions: keys added after version 1 are marked with their version (`SINCE_2`), and a file
has the lowest version that includes all its keys. So a new key is one marked line in a form, here or in the forms of
boundary and substrate: reader, writer and both schemas follow. A choice added later is a form of its own with
``json_schema_extra={SINCE: 2}`` in its `model_config`, and a marked key that identifies it.

Contradictions and collisions are looked for among the parts that are well formed, whatever is wrong elsewhere.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, get_args

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError, field_validator, model_validator
from pydantic import Tag as Choice

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.model.body import Plate, check_pose
from markergen.model.boundary import Boundary
from markergen.model.feature import Feature, Polarity
from markergen.model.json_text import UNNAMED, Location, findings_of, in_one_line, place_path
from markergen.model.marker import ControlPoint, JointCovariance, Marker, MeasuredSize
from markergen.model.openings import hole_clashes, sunk
from markergen.model.rig import Rig
from markergen.model.shape_file import (
    STRICT,
    BoundaryFile,
    Coordinate,
    Finite,
    Positive,
    Size,
    SubstrateFile,
    built,
    holds_together,
)
from markergen.model.tag import FAMILIES, Tag
from markergen.units import LARGEST_LENGTH

FORMAT = "markergen-marker"
VERSIONS = (1, 2)
"""Versions that are read; a file is written in the lowest that has all its keys."""

MOST_CONTROL_POINTS, MOST_PLATES = 1000, 100
"""A marker has a dozen points; a file beyond these limits is not a marker."""
TOLERANCE = 1e-9
"""Maximum overlap in m of a dot with the boundary, another dot or its clearance: rounding, far below any printer."""

HIGHEST = 100.0
"""Maximum distance in m of a dot from the plane z = 0, as of the sizes of boundaries."""

SMALLEST_SCALE, LARGEST_SCALE = 0.5, 2.0
"""Limits of a print's scale; beyond these it is a different marker."""

SINCE = "x-since"
SINCE_2: Any = Field(json_schema_extra={SINCE: 2})
"""Marks a key added in version 2: ``key: Annotated[..., SINCE_2] = default``."""

NonNegative = Annotated[float, Field(ge=0, le=LARGEST_LENGTH)]
Id = Annotated[int, Field(ge=0, le=2**31 - 1)]
Three = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Place = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]


class _MarkerPart(BaseModel):
    model_config = STRICT


class _Frame(_MarkerPart):
    """Marker frame, spelled out for readers of the file without this program."""

    unit: Literal["m"] = "m"
    x: Literal["right"] = "right"
    y: Literal["up"] = "up"
    z: Literal["out of the printed face, toward the viewer"] = "out of the printed face, toward the viewer"
    origin: Literal["center of the boundary's smallest enclosing circle", "that of the boundary's drawing"] = (
        "center of the boundary's smallest enclosing circle"
    )


class _Feature(_MarkerPart):
    kind: Literal["dot", "ring"]
    diameter: Size
    inner_diameter: Size = 0.0
    polarity: Annotated[Polarity, SINCE_2, Field(description="Polarity of the dot on its ground.")] = "dark"


class _MeasuredSize(_MarkerPart):
    """Size of one dot as measured on the print, m."""

    diameter: Positive
    diameter_sigma: Annotated[NonNegative | None, Field(description="Standard deviation; null: unknown.")] = None


class _ControlPoint(_MarkerPart):
    id: Id
    x: Finite
    y: Finite
    z: Finite
    feature: _Feature
    covariance: Annotated[tuple[Finite, Finite, Finite], Field(strict=False)] | None = None
    designed: Annotated[tuple[Finite, Finite], Field(strict=False)] | None = None
    designed_z: Annotated[
        Finite | None, SINCE_2, Field(description="Height that was designed, m, where z was measured.")
    ] = None
    measured: Annotated[_MeasuredSize | None, SINCE_2] = None

    @field_validator("covariance")
    @classmethod
    def _is_one(cls, value: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if value and (min(value[0], value[2]) < 0 or abs(value[1]) > (1 + 1e-9) * (value[0] * value[2]) ** 0.5):
            raise ValueError("xx, xy, yy of no covariance: a variance is negative along some direction")
        return value

    def build(self) -> ControlPoint:
        size = MeasuredSize(self.measured.diameter, self.measured.diameter_sigma) if self.measured else None
        feature = Feature(self.feature.diameter, self.feature.inner_diameter, self.feature.polarity)
        return ControlPoint(
            self.id, self.x, self.y, self.z, feature, self.covariance, self.designed, self.designed_z, size
        )


class _PrintCorrection(_MarkerPart):
    """Scale factors of the printer along x and y; the control points are those of the print."""

    scale_x: Annotated[float, Field(ge=SMALLEST_SCALE, le=LARGEST_SCALE)]
    scale_y: Annotated[float, Field(ge=SMALLEST_SCALE, le=LARGEST_SCALE)]


class _Tag(_MarkerPart):
    """A square tag at z = 0, upright in the marker frame; lengths in m."""

    family: Literal[tuple(FAMILIES)]  # type: ignore[valid-type]  # a table, not a list of words
    id: Annotated[int, Field(ge=0)]
    side: Annotated[Positive, Field(description="Side of the black square.")]
    quiet_zone: Annotated[Positive, Field(description="Width of the white edge around it.")]
    corner_order: Literal["top left, top right, bottom right, bottom left"]
    corners: Annotated[
        list[Place],
        Field(min_length=4, max_length=4, description="Corners of the black square, x y z in the marker frame."),
    ]

    def build(self) -> Tag:
        center = np.mean(self.corners, axis=0)
        # Rounding must not move a center off the origin.
        x, y = (round(float(value), 12) + 0.0 for value in center[:2])
        return Tag(self.family, self.id, self.side, (x, y))


class _JointCovariance(_MarkerPart):
    """Joint covariance of control points measured together, marker frame; replaces their individual covariances."""

    order: Annotated[list[Id], Field(min_length=1, max_length=MOST_CONTROL_POINTS, description="Their ids.")]
    axes: Literal["xy", "xyz"]
    matrix: Annotated[
        list[list[Finite]],
        Field(
            min_length=2,
            max_length=3 * MOST_CONTROL_POINTS,
            description="Symmetric, positive semidefinite, m^2; rows and columns x0 y0 [z0] x1 y1 ... in that order.",
        ),
    ]

    @model_validator(mode="after")
    def _valid(self) -> "_JointCovariance":
        return holds_together(self)

    def build(self) -> JointCovariance:
        return JointCovariance(tuple(self.order), self.axes, tuple(map(tuple, self.matrix)))


class _Rulers(_MarkerPart):
    """Lengths printed beside the sheet's rulers, m; null or missing for a missing ruler."""

    x: Positive | None = None
    y: Positive | None = None


class PoseFile(_MarkerPart):
    """T_outer_inner: X_outer = R X_inner + t."""

    rotation: Annotated[list[Three], Field(min_length=3, max_length=3, description="R, row by row.")]
    translation: Annotated[Place, Field(description="t, m.")]


class _Plate(_MarkerPart):
    """One of several plates; in its own frame x is right, y up, z out of the printed face, which is z = 0."""

    name: Annotated[str, Field(min_length=1, max_length=40)]
    pose: PoseFile
    boundary: Annotated[BoundaryFile, Field(description="In the plate frame.")]
    control_points: Annotated[
        list[Id],
        Field(max_length=MOST_CONTROL_POINTS, description="Ids of the control points on it."),
    ]
    keep_outs: Annotated[list[BoundaryFile], Field(description="In the plate frame.")] = []
    tag: Annotated[_Tag | None, Field(description="In the plate frame.")] = None

    @model_validator(mode="after")
    def _valid(self) -> "_Plate":
        # A tag that contradicts itself is reported with its own path.
        return holds_together(self.model_copy(update={"tag": None})) and self

    def build(self) -> None:
        """Check the pose; raises InputError."""
        check_pose(tuple(map(tuple, self.pose.rotation)), tuple(self.pose.translation))

    def mounted(self, marker: Marker) -> Plate:
        """Return a marker on this plate."""
        return Plate(self.name, marker, tuple(map(tuple, self.pose.rotation)), tuple(self.pose.translation))

    def moved(self, point: ControlPoint) -> ControlPoint:
        """Return a control point in the frame of this plate."""
        rotation, translation = np.array(self.pose.rotation), np.array(self.pose.translation)
        designed_x, designed_y = point.designed or (point.x, point.y)
        designed_z = point.z if point.designed_z is None else point.designed_z
        x, y, z = ((np.array([point.x, point.y, point.z]) - translation) @ rotation).tolist()
        u, v, w = ((np.array([designed_x, designed_y, designed_z]) - translation) @ rotation).tolist()
        is_measured = point.designed is not None or point.designed_z is not None
        return replace(
            point, x=x, y=y, z=z, designed=(u, v) if is_measured else None, designed_z=w if is_measured else None
        )


class MarkerFile(_MarkerPart):
    """A fiducial marker: lengths in m, marker frame x right, y up, z out of the printed face."""

    format: Literal["markergen-marker"]
    version: Literal[VERSIONS]  # type: ignore[valid-type]
    frame: _Frame
    boundary: BoundaryFile
    keep_outs: list[BoundaryFile] = []
    clearance: Size
    control_points: Annotated[list[_ControlPoint], Field(min_length=4, max_length=MOST_CONTROL_POINTS)]
    tag: _Tag | None = None
    substrate: SubstrateFile
    print_correction: _PrintCorrection | None = None
    provenance: dict[str, Any]
    joint_covariance: Annotated[_JointCovariance | None, SINCE_2] = None
    plates: Annotated[
        list[_Plate], SINCE_2, Field(max_length=MOST_PLATES, description="Empty or missing: one plate, z = 0.")
    ] = []
    rulers: Annotated[_Rulers | None, SINCE_2] = None
    extensions: Annotated[dict[str, Any], SINCE_2, Field(description="Of other programs, by name; preserved.")] = {}

    def build(self) -> Marker:
        """Build the marker."""
        correction, rulers = self.print_correction, self.rulers
        return Marker(
            control_points=tuple(point.build() for point in self.control_points),
            boundary=self.boundary.build(),
            clearance=self.clearance,
            substrate=self.substrate.build(),
            provenance=self.provenance,
            keep_outs=built(self.keep_outs),
            tag=self.tag.build() if self.tag else None,
            print_scale=(correction.scale_x, correction.scale_y) if correction else (1, 1),
            joint_covariance=self.joint_covariance.build() if self.joint_covariance else None,
            rulers=(rulers.x, rulers.y) if rulers else None,
            extensions=self.extensions,
        )

    def build_rig(self) -> Rig:
        """Build the rig of a file with plates; what was measured of dots of different plates together is left out."""
        whole = self.build()
        joint = whole.joint_places
        places = {point.id: k for k, point in enumerate(whole.control_points)}
        markers = []
        for plate in self.plates:
            rotation, ids = np.array(plate.pose.rotation), plate.control_points
            dots = [places[number] for number in ids]
            part = replace(
                whole,
                control_points=tuple(plate.moved(whole.control_points[k]) for k in dots),
                boundary=plate.boundary.build(),
                keep_outs=built(plate.keep_outs),
                tag=plate.tag.build() if plate.tag else None,
                joint_covariance=None,
            )
            if joint is not None and (measured := [k for k in dots if np.isfinite(joint[k, :, k]).all()]):
                block = np.einsum("ba,ibjc,cd->iajd", rotation, joint[np.ix_(measured, range(3), measured)], rotation)
                matrix = block.reshape(3 * len(measured), -1)
                rows = tuple(map(tuple, ((matrix + matrix.T) / 2).tolist()))
                order = tuple(whole.control_points[k].id for k in measured)
                part = replace(part, joint_covariance=JointCovariance(order, "xyz", rows))
            markers.append(plate.mounted(part))
        return Rig(tuple(markers), provenance=whole.provenance, extensions=whole.extensions)


Form = type[BaseModel]
Value = TypeVar("Value")
Borders = dict[str, tuple[Boundary, int]]
"""Limits for dots, by name: a boundary (1) from inside, a keep-out (-1) from outside."""


def newer_keys(content: Any, forms: tuple[Form, ...] = (MarkerFile,)) -> Iterator[tuple[Location, int]]:
    """Yield the places of all keys in a file's content that were added after version 1, each with its version."""
    if not forms:
        return
    if isinstance(content, list):
        for index, item in enumerate(content):
            if isinstance(item, dict):  # Not lists of lists, which may be nested without end.
                yield from (((index, *place), version) for place, version in newer_keys(item, forms))
    elif isinstance(content, dict):
        for key, item in content.items():
            since = max(_since(form, key) for form in forms)
            if since > 1:
                yield (key,), since
            yield from (((key, *place), version) for place, version in newer_keys(item, _below(forms, key)))


def known_keys(location: Location, version: int = VERSIONS[-1], root: Form = MarkerFile) -> list[str]:
    """Return the valid keys at a place of a file of some form and version, besides the last one of `location`."""
    forms: tuple[Form, ...] = (root,)
    above = forms, ""
    for step in location[:-1]:
        if isinstance(step, str) and step.startswith(UNNAMED):
            forms = _below(*above, step)
        elif isinstance(step, str):
            above = forms, step
            forms = _below(*above)
    return [key for form in forms for key in form.model_fields if _since(form, key) <= version]


def _since(form: Form, key: str) -> int:
    field = form.model_fields.get(key)
    extra = field.json_schema_extra if field else None
    since = extra.get(SINCE) if isinstance(extra, dict) else None
    return since if isinstance(since, int) else 1


@cache
def _below(forms: tuple[Form, ...], key: str, choice: str = "") -> tuple[Form, ...]:
    """Return the forms below a key: all of its choices, or a given one."""
    fields = [form.model_fields[key] for form in forms if key in form.model_fields]
    choices = [pair for field in fields for pair in _choices(field.annotation)]
    return tuple(form for tag, form in choices if choice in ("", tag))


def _choices(annotation: Any, tag: str = "") -> Iterator[tuple[str, Form]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield tag, annotation
        return
    parts = get_args(annotation)
    tag = next((part.tag for part in parts if isinstance(part, Choice)), tag)
    for part in parts:
        yield from _choices(part, tag)


def checked_file(content: Any, name: str) -> MarkerFile:
    """Check the values of a marker.json; raises InputError, which lists the findings."""
    form = content.get("format") if isinstance(content, dict) else None
    if form != FORMAT:
        kind = f"a {form}" if str(form).startswith("markergen-") else "another kind of file"
        raise InputError(f'"format": "{FORMAT}" in {name}', kind, "give a marker.json written by markergen design")
    version = content.get("version")
    if type(version) is not int or version not in VERSIONS:  # 1.0 and True equal 1, too
        raise _other_version(content, name)
    form, findings = _form_of(content, version)
    findings += [
        f"{place_path(place)}: a key of version {since}, in a file that says version {version}"
        for place, since in newer_keys(content)
        if since > version
    ]
    findings += _contradictions(content, form)
    if form is None or findings:
        raise InputError(f"a valid marker in {name}", in_one_line(findings), "correct these places")
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


def _form_of(content: dict[str, Any], version: int) -> tuple[MarkerFile | None, list[str]]:
    try:
        return MarkerFile.model_validate(content), []
    except ValidationError as error:
        return None, findings_of(error, lambda location: known_keys(location, version))


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


def _contradictions(content: Mapping[str, Any], form: MarkerFile | None) -> list[str]:
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
    misfits = hole_clashes(substrate.holes, disks, parts.clearance, border) + sunk(substrate)
    return [f"substrate.holes[{misfit.hole}]: {misfit.problem}" for misfit in misfits]


def _mm(meters: float) -> str:
    return f"{float(meters) * 1e3:.4g} mm"
