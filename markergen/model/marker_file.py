"""Schema of marker.json, versions 1 and 2: keys, types, and constraints on individual values.

One set of forms serves all versions: keys added after version 1 are marked with their version (`SINCE_2`), and a file
has the lowest version that includes all its keys. So a new key is one marked line in a form, here or in the forms of
boundary and substrate: reader, writer and both schemas follow. A choice added later is a form of its own with
``json_schema_extra={SINCE: 2}`` in its `model_config`, and a marked key that identifies it.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import BaseModel, Field, field_validator, model_validator
from pydantic import Tag as Choice

from markergen.errors import InputError, brief
from markergen.model.body import Plate
from markergen.model.feature import Feature, Polarity
from markergen.model.findings import UNNAMED, Location
from markergen.model.marker import ControlPoint, JointCovariance, Marker, MeasuredSize
from markergen.model.rig import Rig
from markergen.model.rigid import check_pose
from markergen.model.shape_file import STRICT, BoundaryFile, Finite, SubstrateFile, built, holds_together
from markergen.model.tag import FAMILIES, Tag

FORMAT = "markergen-marker"
VERSIONS = (1, 2)

MOST_CONTROL_POINTS, MOST_PLATES = 1000, 100
"""A marker has a dozen points; a file beyond these limits is not a marker."""
TOLERANCE = 1e-9
"""Maximum overlap in m of a dot with the boundary, another dot or its clearance: rounding, far below any printer."""

SMALLEST_SCALE, LARGEST_SCALE = 0.5, 2.0
"""Limits of a print's scale; beyond these it is a different marker."""

SINCE = "x-since"
SINCE_2: Any = Field(json_schema_extra={SINCE: 2})
"""Marks a key added in version 2: ``key: Annotated[..., SINCE_2] = default``."""

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Id = Annotated[int, Field(ge=0, le=2**31 - 1)]
Three = Annotated[list[Finite], Field(min_length=3, max_length=3)]


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
    diameter: NonNegative
    inner_diameter: NonNegative = 0.0
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
    side: Annotated[float, Field(gt=0, allow_inf_nan=False, description="Side of the black square.")]
    quiet_zone: Annotated[float, Field(gt=0, allow_inf_nan=False, description="Width of the white edge around it.")]
    corner_order: Literal["top left, top right, bottom right, bottom left"]
    corners: Annotated[
        list[Three],
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
    translation: Annotated[Three, Field(description="t, m.")]


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
    clearance: NonNegative
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


def known_keys(location: Location, version: int) -> list[str]:
    """Return the valid keys at a place of a file of some version, besides the last one of `location`."""
    forms: tuple[Form, ...] = (MarkerFile,)
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


def json_schema(version: int) -> dict[str, Any]:
    """Return the JSON Schema of one version of marker.json.

    Raises
    ------
    InputError
        If there is no such version.
    """
    if version not in VERSIONS:
        raise InputError("a version of marker.json", brief(version), f"known: {', '.join(map(str, VERSIONS))}")
    schema = MarkerFile.model_json_schema()
    _without_newer(schema, version)
    schema["properties"]["version"] = {"const": version, "title": "Version", "type": "integer"}
    used = set[str]()
    _collect(schema["properties"], schema["$defs"], used)
    schema["$defs"] = {name: form for name, form in schema["$defs"].items() if name in used}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _without_newer(schema: Any, version: int) -> None:
    """Remove the keys added after a version, and the newer choices of forms."""
    newer = {f"#/$defs/{name}" for name, form in schema["$defs"].items() if form.get(SINCE, 1) > version}

    def clean(part: Any) -> None:
        if isinstance(part, dict):
            for key, value in list(part.get("properties", {}).items()):
                if value.get(SINCE, 1) > version:
                    del part["properties"][key]
            if "oneOf" in part:
                part["oneOf"] = [form for form in part["oneOf"] if form.get("$ref") not in newer]
        for item in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
            clean(item)

    clean(schema)


def _collect(schema: Any, forms: dict[str, Any], used: set[str]) -> None:
    """Collect the names of all forms that a schema refers to, directly or indirectly."""
    if isinstance(schema, list):
        for item in schema:
            _collect(item, forms, used)
    elif isinstance(schema, dict):
        name = str(schema.get("$ref", "")).rpartition("/")[2]
        if name and name not in used:
            used.add(name)
            _collect(forms[name], forms, used)
        for item in schema.values():
            _collect(item, forms, used)
