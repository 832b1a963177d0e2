"""The substrate: the plate that carries the dots when a marker is made as a solid."""

from dataclasses import asdict, dataclass, fields
from math import isfinite
from typing import Any, Literal

from markergen.errors import InputError
from markergen.model.boundary import Boundary, Circle
from markergen.units import format_length

THINNEST, LARGEST = 1e-5, 1.0
"""Of a plate's thickness and its other measures in m; beyond these a unit is missing."""

EDGE = 0.002
"""Width in m of the plate around a disk or a rectangle, unless another is given."""

MOST_HOLES = 200


@dataclass(frozen=True)
class Hole:
    """A round hole through the plate.

    Attributes
    ----------
    x, y : float
        Of its axis in the marker frame, m.
    diameter : float
        m.
    sink : float
        Diameter in m of a countersink of 90 degrees at the printed face; 0 is none.
    use : {"mount", "dowel"}
        A screw goes through the one, a pin that tells where the frame is fits the other.
    name : str
        What goes through, such as ``M3``.

    Raises
    ------
    InputError
        If the place is not finite, the diameter is not above 0, or the countersink is not wider than the hole.
    """

    x: float
    y: float
    diameter: float
    sink: float = 0.0
    use: Literal["mount", "dowel"] = "mount"
    name: str = ""

    def __post_init__(self) -> None:
        if not (isfinite(self.x) and isfinite(self.y)):
            raise InputError("a hole at a finite place", f"({self.x}, {self.y}) m", "give two lengths")
        if not 0 < self.diameter <= LARGEST:
            raise InputError(
                f"a hole's diameter above 0, and of at most {format_length(LARGEST)}",
                f"{self.diameter} m",
                "write a screw such as M3, or a length with its unit such as 3.4mm",
            )
        if self.sink and not self.diameter < self.sink <= LARGEST:
            raise InputError(
                f"a countersink wider than its hole of {format_length(self.diameter)}",
                f"sink={self.sink} m",
                "give a larger one, or 0 for none",
            )

    @property
    def radius(self) -> float:
        """Radius in m of what is missing from the printed face."""
        return max(self.diameter, self.sink) / 2

    @property
    def bore(self) -> Circle:
        """What goes through."""
        return Circle(self.diameter / 2, (self.x, self.y))

    @property
    def rim(self) -> Circle:
        """Where the printed face has the hole."""
        return Circle(self.radius, (self.x, self.y))

    def __str__(self) -> str:
        kind = self.name or format_length(self.diameter)
        place = f"{format_length(round(self.x, 9))}, {format_length(round(self.y, 9))}"
        return f"the {'dowel hole' if self.use == 'dowel' else 'hole'} {kind} at {place}"


@dataclass(frozen=True)
class Substrate:
    """A plate whose upper face is z = 0.

    Attributes
    ----------
    thickness : float
        m.
    edge : float or None
        Least width in m of the plate outside of a boundary that is a disk or a rectangle, None for `EDGE`; without
        effect on others, and where an outline is given (see `edge_around`).
    corner_radius : float
        Of the outline's corners seen from above, m.
    chamfer : float
        Of the edge around the upper face, 45 degrees, m.
    outline : Boundary or None
        The plate's own outline; None is the boundary, with an edge around a disk or a rectangle.
    holes : tuple of Hole

    Raises
    ------
    InputError
        If a measure is negative, not finite, or beyond reason, the chamfer leaves nothing of the plate's side, or there
        are more than `MOST_HOLES` holes.
    """

    thickness: float = 0.003
    edge: float | None = None
    corner_radius: float = 0.0
    chamfer: float = 0.0
    outline: Boundary | None = None
    holes: tuple[Hole, ...] = ()

    def __post_init__(self) -> None:
        if not THINNEST <= self.thickness <= LARGEST:
            raise InputError(
                f"a thickness of {THINNEST * 1e6:g} um to {format_length(LARGEST)}",
                f"thickness={self.thickness} m",
                "give --thickness a length such as 3mm",
            )
        for name, option in (("edge", "--edge 2mm"), ("corner_radius", "--corner-radius 5mm")):
            if getattr(self, name) is not None and not 0 <= getattr(self, name) <= LARGEST:
                raise InputError(
                    f"a plate's {name.replace('_', ' ')} of 0 to {format_length(LARGEST)}",
                    f"{name}={getattr(self, name)} m",
                    f"use {option}, for example",
                )
        if not 0 <= self.chamfer < self.thickness:
            raise InputError(
                f"a chamfer of 0 or more, and below the thickness of {format_length(self.thickness)}",
                f"chamfer={self.chamfer} m",
                "use --chamfer 0.5mm, for example",
            )
        if len(self.holes) > MOST_HOLES:
            raise InputError(f"at most {MOST_HOLES} holes", f"{len(self.holes)}", "leave some out")

    @property
    def rims(self) -> tuple[Circle, ...]:
        """Where the upper face has its holes."""
        return tuple(hole.rim for hole in self.holes)

    def edge_around(self, boundary: Boundary) -> float:
        """Width in m of the plate outside of a boundary.

        A disk and a rectangle are where the dots lie, and the plate is larger. An outline that was drawn is the plate,
        holes and all: nothing is added to it. Nor is anything where the plate has an outline of its own.
        """
        if self.outline is not None or not boundary.has_measures:
            return 0.0
        return EDGE if self.edge is None else self.edge

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, lengths in m: the thickness, and of all else what is not the default."""
        default = Substrate()
        values: dict[str, Any] = {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if field.name == "thickness" or getattr(self, field.name) != getattr(default, field.name)
        }
        if self.outline is not None:
            values["outline"] = self.outline.as_dict()
        if self.holes:
            values["holes"] = [asdict(hole) for hole in self.holes]
        return values
