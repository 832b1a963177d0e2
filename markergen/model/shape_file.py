"""Schemas of boundaries, keep-outs and plates in files; lengths in m."""
# tests: tests/model/test_boundary.py

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from markergen.errors import InputError
from markergen.geometry.outlines import Ring
from markergen.model.boundary import Boundary, Circle, Polygon
from markergen.model.json_text import UNNAMED
from markergen.model.substrate import EDGE, LARGEST, MOST_HOLES, THINNEST, Hole, Substrate
from markergen.units import LARGEST_LENGTH, SMALLEST_LENGTH

Finite = Annotated[float, Field(allow_inf_nan=False)]


def _no_dust(value: float) -> float:
    if value < SMALLEST_LENGTH:
        raise ValueError("give a size of 1 um to 1 km")
    return value


Size = Annotated[float, Field(ge=0, le=LARGEST_LENGTH), AfterValidator(lambda value: value and _no_dust(value))]
"""A length in m, or zero for none."""
Positive = Annotated[float, Field(gt=0, le=LARGEST_LENGTH), AfterValidator(_no_dust)]
Coordinate = Annotated[float, Field(ge=-LARGEST_LENGTH, le=LARGEST_LENGTH)]
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Width = Annotated[float, Field(ge=0, le=LARGEST)]

STRICT = ConfigDict(extra="forbid", strict=True, defer_build=True)
"""Strict validation: no unknown keys, no conversions; forms are built when first used, usually inside larger ones."""


def holds_together(file: Any) -> Any:
    """Build a part to validate it, and report contradictions in pydantic's way."""
    try:
        file.build()
    except InputError as error:
        raise ValueError(str(error)) from None
    return file


class _ShapePart(BaseModel):
    model_config = STRICT


class CircleFile(_ShapePart):
    """A disk, around the origin unless it has a center; m."""

    kind: Literal["circle"]
    radius: Positive
    center: Point = [0.0, 0.0]

    def build(self) -> Boundary:
        """Build the boundary."""
        return Circle(self.radius, (self.center[0], self.center[1]))


class PolygonFile(_ShapePart):
    """Closed outlines of corners [x, y] in m, the last joined to the first; one within another is a hole in it."""

    kind: Literal["polygon"]
    outlines: Annotated[list[Annotated[list[Point], Field(min_length=3)]], Field(min_length=1)]

    @model_validator(mode="after")
    def _valid(self) -> "PolygonFile":
        return holds_together(self)

    def build(self) -> Boundary:
        """Build the boundary."""
        return Polygon(_corners(self.outlines))


class ArcsFile(_ShapePart):
    """A polygon with some edges that are circular arcs; a full circle is two of them.

    There is one bulge for each corner of each outline: the tangent of a quarter of the angle by which the edge to the
    next corner turns, counterclockwise positive, 0 for a straight edge.
    """

    # Since version 2 of marker.json, whose forms are defined a layer above.
    model_config = ConfigDict(json_schema_extra={"x-since": 2})

    kind: Literal["polygon"]
    outlines: Annotated[list[Annotated[list[Point], Field(min_length=2)]], Field(min_length=1)]
    bulges: Annotated[
        list[Annotated[list[Annotated[float, Field(ge=-1, le=1)]], Field(min_length=2)]],
        Field(min_length=1, json_schema_extra={"x-since": 2}),
    ]

    @model_validator(mode="after")
    def _valid(self) -> "ArcsFile":
        return holds_together(self)

    def build(self) -> Boundary:
        """Build the boundary."""
        return Polygon(_corners(self.outlines), tuple(map(tuple, self.bulges)))


def _corners(outlines: list[list[Point]]) -> tuple[Ring, ...]:
    return tuple(tuple((x, y) for x, y in outline) for outline in outlines)


def _kind(value: object) -> str | None:
    kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
    arcs = kind == "polygon" and (isinstance(value, ArcsFile) or (isinstance(value, Mapping) and "bulges" in value))
    return UNNAMED + ("arcs" if arcs else kind) if isinstance(kind, str) else None


BoundaryFile = Annotated[
    Annotated[CircleFile, Tag(UNNAMED + "circle")]
    | Annotated[PolygonFile, Tag(UNNAMED + "polygon")]
    | Annotated[ArcsFile, Tag(UNNAMED + "arcs")],
    Discriminator(
        _kind, custom_error_type="kind", custom_error_message="Input should be a table with kind circle or polygon"
    ),
]


def built(file: Any) -> tuple[Boundary, ...]:
    """Build all boundaries of a list."""
    return tuple(item.build() for item in file)


class HoleFile(_ShapePart):
    """A round hole through the plate; `sink` is the diameter of a countersink of 90 degrees at the printed face."""

    x: Coordinate
    y: Coordinate
    diameter: Annotated[float, Field(gt=0, le=LARGEST)]
    sink: Width = 0.0
    use: Literal["mount", "dowel"] = "mount"
    name: Annotated[str, Field(max_length=40)] = ""

    @model_validator(mode="after")
    def _valid(self) -> "HoleFile":
        return holds_together(self)

    def build(self) -> Hole:
        """Build the hole."""
        return Hole(self.x, self.y, self.diameter, self.sink, self.use, self.name)


class SubstrateFile(_ShapePart):
    """The plate that carries the dots when the marker is made as a solid; its upper face is z = 0."""

    thickness: Annotated[float, Field(ge=THINNEST, le=LARGEST)] = Substrate.thickness
    edge: Annotated[
        Width,
        Field(description="Minimum width outside the boundary.", json_schema_extra={"default": EDGE}),
    ] = Substrate.edge  # type: ignore[assignment]  # None is left out of files: an edge in a file is a number
    corner_radius: Annotated[Width, Field(description="Radius in plan view.")] = Substrate.corner_radius
    chamfer: Annotated[Width, Field(description="Width around the upper face.")] = Substrate.chamfer
    outline: Annotated[BoundaryFile | None, Field(description="Instead of the boundary with its edge.")] = None
    holes: Annotated[list[HoleFile], Field(max_length=MOST_HOLES)] = []

    @model_validator(mode="after")
    def _valid(self) -> "SubstrateFile":
        return holds_together(self)

    def build(self) -> Substrate:
        """Build the substrate."""
        return Substrate(
            self.thickness,
            self.edge,
            self.corner_radius,
            self.chamfer,
            self.outline.build() if self.outline else None,
            tuple(hole.build() for hole in self.holes),
        )
