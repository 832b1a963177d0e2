"""The substrate in files, checked with every finding's path; lengths in m."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from markergen.errors import InputError
from markergen.model.boundary_file import BoundaryFile, Finite
from markergen.model.substrate import EDGE, LARGEST, MOST_HOLES, THINNEST, Hole, Substrate

Width = Annotated[float, Field(ge=0, le=LARGEST)]


class _Strict(BaseModel):
    # Built when first used, most often as a part of a larger form.
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)


class HoleFile(_Strict):
    """A round hole through the plate; `sink` is the diameter of a countersink of 90 degrees at the printed face."""

    x: Finite
    y: Finite
    diameter: Annotated[float, Field(gt=0, le=LARGEST)]
    sink: Width = 0.0
    use: Literal["mount", "dowel"] = "mount"
    name: Annotated[str, Field(max_length=40)] = ""

    @model_validator(mode="after")
    def _valid(self) -> "HoleFile":
        return _checked(self)

    def build(self) -> Hole:
        """Make the hole."""
        return Hole(self.x, self.y, self.diameter, self.sink, self.use, self.name)


class SubstrateFile(_Strict):
    """The plate that carries the dots when the marker is made as a solid; its upper face is z = 0."""

    thickness: Annotated[float, Field(ge=THINNEST, le=LARGEST)] = Substrate.thickness
    edge: Annotated[
        Width,
        Field(description="Least width outside of the boundary.", json_schema_extra={"default": EDGE}),
    ] = Substrate.edge  # type: ignore[assignment]  # left out; a file that has one has a number
    corner_radius: Annotated[Width, Field(description="Of the outline, seen from above.")] = Substrate.corner_radius
    chamfer: Annotated[Width, Field(description="Around the upper face.")] = Substrate.chamfer
    outline: Annotated[BoundaryFile | None, Field(description="Instead of the boundary with its edge.")] = None
    holes: Annotated[list[HoleFile], Field(max_length=MOST_HOLES)] = []

    @model_validator(mode="after")
    def _valid(self) -> "SubstrateFile":
        return _checked(self)

    def build(self) -> Substrate:
        """Make the substrate."""
        return Substrate(
            self.thickness,
            self.edge,
            self.corner_radius,
            self.chamfer,
            self.outline.build() if self.outline else None,
            tuple(hole.build() for hole in self.holes),
        )


def _checked(file: Any) -> Any:
    """Tell what contradicts itself as pydantic tells what is wrong with a value."""
    try:
        file.build()
    except InputError as error:
        raise ValueError(str(error)) from None
    return file
