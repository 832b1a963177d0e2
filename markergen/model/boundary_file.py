"""Boundaries and keep-outs in files: a circle, or a polygon with its outlines, checked with every finding's path."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from markergen.errors import InputError
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
        try:
            self.build()
        except InputError as error:
            raise ValueError(str(error)) from None
        return self

    def build(self) -> Boundary:
        """Make the boundary."""
        return Polygon(tuple(tuple((x, y) for x, y in outline) for outline in self.outlines))


def _kind(value: object) -> str | None:
    kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
    return UNNAMED + kind if isinstance(kind, str) else None


BoundaryFile = Annotated[
    Annotated[CircleFile, Tag(UNNAMED + "circle")] | Annotated[PolygonFile, Tag(UNNAMED + "polygon")],
    Discriminator(
        _kind, custom_error_type="kind", custom_error_message="Input should be a table with kind circle or polygon"
    ),
]


def built(file: Any) -> tuple[Boundary, ...]:
    """Boundaries of a list of them."""
    return tuple(item.build() for item in file)
