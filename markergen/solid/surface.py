"""What a solid shows from above, as plain data in mm in the frame of its file: level faces, balls, and their colors."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Color = tuple[float, float, float]
Circle = tuple[float, float, float]
"""x, y, radius."""


@dataclass(frozen=True, eq=False)
class Loop:
    """One closed edge of a face.

    Attributes
    ----------
    points : array (k, 2)
        On it, in order; the corners and, of arcs, some points between.
    circle : (x, y, radius) or None
        What it is if it is round.
    """

    points: Array
    circle: Circle | None = None

    def scaled(self, factor: float) -> "Loop":
        """A factor as large."""
        x, y, r = self.circle or (0.0, 0.0, 0.0)
        return Loop(factor * self.points, (factor * x, factor * y, factor * r) if self.circle else None)

    @cached_property
    def area(self) -> float:
        """Of what it encloses, mm^2."""
        if self.circle:
            return float(np.pi * self.circle[2] ** 2)
        x, y = self.points.T
        return abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lowest and highest x, y."""
        if self.circle:
            x, y, r = self.circle
            return np.array([x - r, y - r]), np.array([x + r, y + r])
        return self.points.min(axis=0), self.points.max(axis=0)

    def holds(self, places: Array) -> NDArray[np.bool_]:
        """Tell which places (m, 2) lie within, by the parity of the sides that a ray to the right crosses."""
        if self.circle:
            x, y, r = self.circle
            return np.asarray(np.hypot(places[:, 0] - x, places[:, 1] - y) < r)
        low, high = self.box
        inside = np.asarray(((places > low) & (places < high)).all(axis=-1))
        if not inside.any():
            return inside
        u, v = places[inside, 0, None], places[inside, 1, None]
        (x0, y0), (x1, y1) = self.points.T, np.roll(self.points, -1, axis=0).T
        spans = (y0 > v) != (y1 > v)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossed = spans & (u < x0 + (v - y0) / (y1 - y0) * (x1 - x0))
        inside[inside] = crossed.sum(axis=-1) % 2 == 1
        return inside


@dataclass(frozen=True, eq=False)
class Face:
    """A level face that is seen from above; its loops, the outer one first."""

    z: float
    loops: tuple[Loop, ...]
    color: Color | None = None

    def scaled(self, factor: float) -> "Face":
        """A factor as large."""
        return Face(factor * self.z, tuple(loop.scaled(factor) for loop in self.loops), self.color)

    def holds(self, places: Array) -> NDArray[np.bool_]:
        """Tell which places (m, 2) lie in it."""
        inside = self.loops[0].holds(places)
        for hole in self.loops[1:]:
            if inside.any():
                inside[inside] = ~hole.holds(places[inside])
        return inside


@dataclass(frozen=True)
class Ball:
    """A piece of a sphere that is seen from above.

    Attributes
    ----------
    x, y, z, radius : float
    hole : float
        Radius of the circle around its upright axis within which it is cut away from the top; 0 of a whole cap.
    rim : float
        Radius up to which it reaches as seen from above.
    """

    x: float
    y: float
    z: float
    radius: float
    hole: float = 0.0
    rim: float = 0.0
    color: Color | None = None

    def scaled(self, factor: float) -> "Ball":
        """A factor as large."""
        x, y, z, radius, hole, rim = (factor * v for v in (self.x, self.y, self.z, self.radius, self.hole, self.rim))
        return Ball(x, y, z, radius, hole, rim, self.color)


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
        Whether it is a sound solid, and has no open edge.
    low, high : (x, y, z)
        Corners of a box that holds it.
    faces : tuple of Face
        Level ones that look up.
    balls : tuple of Ball
    """

    name: str
    color: Color | None
    volume: float
    valid: bool
    closed: bool
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    faces: tuple[Face, ...]
    balls: tuple[Ball, ...] = ()

    def scaled(self, factor: float) -> "SolidPart":
        """A factor as large."""
        low, high = ((factor * x, factor * y, factor * z) for x, y, z in (self.low, self.high))
        faces = tuple(face.scaled(factor) for face in self.faces)
        balls = tuple(ball.scaled(factor) for ball in self.balls)
        return replace(self, volume=factor**3 * self.volume, low=low, high=high, faces=faces, balls=balls)

    @property
    def circles(self) -> list[tuple[float, float, float, float]]:
        """Round edges (x, y, z, radius) of its level faces."""
        return [
            (loop.circle[0], loop.circle[1], face.z, loop.circle[2])
            for face in self.faces
            for loop in face.loops
            if loop.circle
        ]


@dataclass(frozen=True, eq=False)
class Surface:
    """All parts of a file."""

    parts: tuple[SolidPart, ...] = field(default=())

    def scaled(self, factor: float) -> "Surface":
        """A factor as large."""
        return Surface(tuple(part.scaled(factor) for part in self.parts))

    def look(self, places: Array) -> tuple[NDArray[np.intp], Array, list[Color | None]]:
        """What a vertical look from above meets at places (m, 2).

        Returns
        -------
        part (m,), z (m,), color
            Index of the part, -1 where there is none; height, -inf there; color, None where the file has none.
        """
        part = np.full(len(places), -1, dtype=np.intp)
        z = np.full(len(places), -np.inf)
        colors: list[Color | None] = [None] * len(places)

        def show(index: int, heights: Array, color: Color | None) -> None:
            for k in np.flatnonzero(heights > z):
                part[k], z[k], colors[k] = index, heights[k], color

        for index, each in enumerate(self.parts):
            for face in each.faces:
                inside = face.holds(places) if face.z > z.min(initial=np.inf) else np.zeros(len(places), dtype=bool)
                if inside.any():
                    show(index, np.where(inside, face.z, -np.inf), face.color or each.color)
            for ball in each.balls:
                away = np.hypot(places[:, 0] - ball.x, places[:, 1] - ball.y)
                inside = (away < ball.rim) & (away >= ball.hole)
                if inside.any():
                    up = np.sqrt(np.maximum(ball.radius**2 - away**2, 0.0))
                    show(index, np.where(inside, ball.z + up, -np.inf), ball.color or each.color)
        return part, z, colors
