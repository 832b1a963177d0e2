"""The plan view of a solid as plain data, in mm in the frame of its file: level faces, balls, and their colors."""

# tests: tests/verification/test_solid_readers.py

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.geometry.contour import Contour, circle, flattened
from markergen.geometry.region import Region

Color = tuple[float, float, float]

FINE = 1e-3
"""Maximum distance in mm between a circle and its chords when points are looked up."""


def edge_of(points: Array, round_one: tuple[float, float, float] | None = None) -> Contour:
    """Make a closed edge of a face: a circle from (x, y, radius) if given, else the polygon of points (k, 2)."""
    if round_one is not None:
        x, y, radius = round_one
        return circle(radius, x, y)
    return Contour(tuple((x, y) for x, y in points.tolist()))


def _scaled(edge: Contour, factor: float) -> Contour:
    return Contour(tuple((factor * x, factor * y) for x, y in edge.points), edge.bulges)


def out_of_round(points: Array, about: tuple[float, float, float], chords: bool = True) -> float:
    """Maximum distance in mm of a closed line through points (k, 2) from a circle; of the points alone if curved."""
    x, y, radius = about
    seen = np.concatenate([points, (points + np.roll(points, 1, axis=0)) / 2]) if chords else points
    return float(np.abs(np.hypot(*(seen - [x, y]).T) - radius).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class LevelFace:
    """A level face.

    Attributes
    ----------
    edges : tuple of Contour
        The outer one first.
    color : (red, green, blue) or None
    rough : tuple of float
        Maximum distance in mm between each edge and the circle that it stands for; empty if all are exact.
    """

    z: float
    edges: tuple[Contour, ...]
    color: Color | None = None
    rough: tuple[float, ...] = ()

    def scaled(self, factor: float) -> "LevelFace":
        """Scale by a factor."""
        edges, rough = (
            tuple(_scaled(edge, factor) for edge in self.edges),
            tuple(factor * value for value in self.rough),
        )
        return LevelFace(factor * self.z, edges, self.color, rough)

    @cached_property
    def region(self) -> Region:
        """Region that the face covers."""
        outer, *holes = (flattened(edge, FINE) for edge in self.edges)
        return Region.polygon(outer, holes, mend=True)

    @cached_property
    def outline(self) -> Region:
        """Region inside its outer edge."""
        return Region.polygon(flattened(self.edges[0], FINE), mend=True)


@dataclass(frozen=True)
class Ball:
    """A piece of a sphere that is seen from above.

    Attributes
    ----------
    hole : float
        Radius of the circle around its vertical axis inside which the top is cut away; 0 for a whole cap.
    rim : float
        Radius of the rim in plan view.
    color : (red, green, blue) or None
    flatness : float
        Height over width: 1 for a ball, less for one that was squashed.
    """

    x: float
    y: float
    z: float
    radius: float
    hole: float = 0.0
    rim: float = 0.0
    color: Color | None = None
    flatness: float = 1.0

    def scaled(self, factor: float) -> "Ball":
        """Scale by a factor."""
        x, y, z, radius, hole, rim = (factor * v for v in (self.x, self.y, self.z, self.radius, self.hole, self.rim))
        return Ball(x, y, z, radius, hole, rim, self.color, self.flatness)


@dataclass(frozen=True, eq=False)
class SolidPart:
    """One part of a file.

    Attributes
    ----------
    name : str
        Empty where the format has none.
    color : (red, green, blue) or None
        From 0 to 1.
    volume : float
        mm^3.
    valid, closed : bool
        True if it is a valid solid, and if it has no open edges.
    low, high : (x, y, z)
        Corners of its bounding box.
    faces : tuple of LevelFace
        Level faces that face up.
    backs : tuple of LevelFace
        Level faces that face down.
    tool : str
        Number of the extruder that prints it; empty if the file does not say.
    """

    name: str
    color: Color | None
    volume: float
    valid: bool
    closed: bool
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    faces: tuple[LevelFace, ...]
    balls: tuple[Ball, ...] = ()
    backs: tuple[LevelFace, ...] = ()
    tool: str = ""

    def scaled(self, factor: float) -> "SolidPart":
        """Scale by a factor."""
        low, high = ((factor * x, factor * y, factor * z) for x, y, z in (self.low, self.high))
        faces, backs = (tuple(face.scaled(factor) for face in level_faces) for level_faces in (self.faces, self.backs))
        balls = tuple(ball.scaled(factor) for ball in self.balls)
        return replace(
            self, volume=factor**3 * self.volume, low=low, high=high, faces=faces, balls=balls, backs=backs
        )  # fmt: skip

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top in plan view."""
        return self.low[0], self.low[1], self.high[0], self.high[1]

    @property
    def circles(self) -> list[tuple[float, float, float, float]]:
        """Round edges (x, y, z, radius) of its level faces."""
        edges = [(face.z, edge.as_circle) for face in self.faces for edge in face.edges]
        return [(about[0], about[1], z, about[2]) for z, about in edges if about is not None]


def _no_views() -> "list[Surface]":
    return []


@dataclass(frozen=True, eq=False)
class Surface:
    """Plan view of all parts of a file.

    Attributes
    ----------
    views : callable
        Returns other views of the same solid, with another of its sides up.
    mapped : callable or None
        Returns the plan view of the solid after a linear map (3, 3); None for solids that are only scaled.
    loose : bool
        True for parts of dots without a plate around them.
    rotation : array (3, 3)
        From the frame of the file to that of the view.
    triangles : array (m, 3, 3) or None
        The whole surface, roughly where it is curved; None where it is not looked at.
    """

    parts: tuple[SolidPart, ...] = field(default=())
    views: "Callable[[], list[Surface]]" = _no_views
    mapped: "Callable[[Array], Surface] | None" = None
    loose: bool = False
    rotation: Array = field(default_factory=lambda: np.eye(3))
    triangles: Array | None = None

    @property
    def round_dots(self) -> bool:
        """True if there are balls."""
        return any(part.balls for part in self.parts)

    def scaled(self, factor: float) -> "Surface":
        """Scale by a factor."""
        if self.mapped is not None:
            return replace(self.mapped(factor * np.eye(3)), rotation=self.rotation)
        return Surface(tuple(part.scaled(factor) for part in self.parts), loose=self.loose, rotation=self.rotation)

    def look(self, places: Array) -> tuple[NDArray[np.intp], Array, list[Color | None]]:
        """Look down vertically at points (m, 2).

        Returns
        -------
        part (m,), z (m,), color
            Index of the part, -1 for none; height, -inf for none; color, None if the file has none.
        """
        part = np.full(len(places), -1, dtype=np.intp)
        z = np.full(len(places), -np.inf)
        colors: list[Color | None] = [None] * len(places)

        def show(index: int, heights: Array, color: Color | None) -> None:
            for k in np.flatnonzero(heights > z):
                part[k], z[k], colors[k] = index, heights[k], color

        for index, solid in enumerate(self.parts):
            for face in solid.faces:
                if face.z > z.min(initial=np.inf):
                    inside = face.region.contains(places)
                    show(index, np.where(inside, face.z, -np.inf), face.color or solid.color)
            for ball in solid.balls:
                away = np.hypot(places[:, 0] - ball.x, places[:, 1] - ball.y)
                inside = (away < ball.rim) & (away >= ball.hole)
                if inside.any():
                    up = np.sqrt(np.maximum(ball.radius**2 - away**2, 0.0))
                    show(index, np.where(inside, ball.z + up, -np.inf), ball.color or solid.color)
        return part, z, colors


def rotation_up(direction: Array) -> Array:
    """Rotation (3, 3) by the smallest angle that turns a unit vector (3,) up; over the x-axis if it points down."""
    x, y, z = direction
    if z < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    return np.array(
        [[1 - x * x / (1 + z), -x * y / (1 + z), -x], [-x * y / (1 + z), 1 - y * y / (1 + z), -y], [x, y, z]]
    )
