"""Boundaries and keep-outs in files: a circle, or a polygon with or without arcs, checked with every finding's path."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from markergen.errors import InputError
from markergen.geometry.outlines import Ring
from markergen.model.boundary import Boundary, Circle, Polygon
from markergen.model.findings import UNNAMED

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Point = Annotated[list[Finite], Field(min_length=2, max_length=2)]


class _Strict(BaseModel):
    # Built when first used, most often as a part of a larger form.
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)


class CircleFile(_Strict):
    """A disk, around the origin unless it has a center; m."""

    kind: Literal["circle"]
    radius: Positive
    center: Point = [0.0, 0.0]

    def build(self) -> Boundary:
        """Make the boundary."""
        return Circle(self.radius, (self.center[0], self.center[1]))


class PolygonFile(_Strict):
    """Closed outlines of corners [x, y] in m, the last joined to the first; one within another is a hole in it."""

    kind: Literal["polygon"]
    outlines: Annotated[list[Annotated[list[Point], Field(min_length=3)]], Field(min_length=1)]

    @model_validator(mode="after")
    def _valid(self) -> "PolygonFile":
        return _checked(self)

    def build(self) -> Boundary:
        """Make the boundary."""
        return Polygon(_corners(self.outlines))


class ArcsFile(_Strict):
    """A polygon some of whose edges are arcs of circles, a full circle being two.

    Bulges are one for each corner of each outline: the tangent of a quarter of the angle by which the edge to the next
    corner turns, counterclockwise positive, 0 where it is straight.
    """

    # Since version 2 of marker.json, whose forms are made a layer above.
    model_config = ConfigDict(json_schema_extra={"x-since": 2})

    kind: Literal["polygon"]
    outlines: Annotated[list[Annotated[list[Point], Field(min_length=2)]], Field(min_length=1)]
    bulges: Annotated[
        list[Annotated[list[Annotated[float, Field(ge=-1, le=1)]], Field(min_length=2)]],
        Field(min_length=1, json_schema_extra={"x-since": 2}),
    ]

    @model_validator(mode="after")
    def _valid(self) -> "ArcsFile":
        return _checked(self)

    def build(self) -> Boundary:
        """Make the boundary."""
        return Polygon(_corners(self.outlines), tuple(map(tuple, self.bulges)))


def _corners(outlines: list[list[Point]]) -> tuple[Ring, ...]:
    return tuple(tuple((x, y) for x, y in outline) for outline in outlines)


def _checked(file: Any) -> Any:
    """Tell what is wrong with a shape as pydantic tells what is wrong with a value."""
    try:
        file.build()
    except InputError as error:
        raise ValueError(str(error)) from None
    return file


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
    """Boundaries of a list of them."""
    return tuple(item.build() for item in file)
