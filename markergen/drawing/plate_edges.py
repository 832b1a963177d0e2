"""Straight edges of a body's plates, the plates that they meet, and labels beside them."""
# tests: tests/drawing/test_paper_net.py

from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array
from markergen.drawing.scene import GRAY, Point, Shape
from markergen.drawing.text import text, text_width
from markergen.model.body import Body

SAME = 1e-6
"""Maximum distance in m of corners that are one."""

LABEL, NAME, AIR = 1.5, 2.2, 1.0
"""Cap heights of the labels of edges and of a plate's name, and their distance from its outline, mm on A4."""


@dataclass(frozen=True)
class Edge:
    """An edge of a plate, counterclockwise around it.

    Attributes
    ----------
    start, end : (x, y)
        In mm, marker frame.
    meets : (int, int) or None
        Plate and edge of it that is the same line in the rig; None if there is none.
    """

    start: Point
    end: Point
    meets: tuple[int, int] | None

    @property
    def length(self) -> float:
        """Length in mm."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    @property
    def outward(self) -> Array:
        """Unit vector (2,) out of the plate."""
        along = np.subtract(self.end, self.start) / self.length
        return np.array([along[1], -along[0]])


def plate_edges(body: Body) -> list[list[Edge]]:
    """Edges of each plate whose boundary is one outline of straight edges; none for others."""
    corners = [_corners(body, k) for k in range(len(body.plates))]
    places = [body.plates[k].to_body(np.column_stack([ring, np.zeros(len(ring))])) for k, ring in enumerate(corners)]
    edges_by_plate = []
    for k, outline in enumerate(corners):
        edges = []
        for i in range(len(outline)):
            ends = places[k][[i, (i + 1) % len(outline)]]
            meets = next(
                (
                    (neighbor, j)
                    for neighbor, spots in enumerate(places)
                    if neighbor != k
                    for j in range(len(spots))
                    if np.abs(spots[[(j + 1) % len(spots), j]] - ends).max() <= SAME
                ),
                None,
            )
            start, end = (tuple((outline[at % len(outline)] * 1e3).tolist()) for at in (i, i + 1))
            edges.append(Edge(start, end, meets))
        edges_by_plate.append(edges)
    return edges_by_plate


def _corners(body: Body, k: int) -> Array:
    boundary = body.plates[k].marker.boundary
    contours = boundary.contours()
    if len(contours) != 1 or contours[0].has_arcs:
        return np.zeros((0, 2))
    points = np.array(contours[0].points)
    x, y = points.T
    area = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return points if area > 0 else points[::-1]


def plate_labels(body: Body, k: int, edges: list[Edge], scale: float) -> tuple[Shape, ...]:
    """Name of a plate below it, and beside each edge the plate that it meets; mm, marker frame."""
    marker = body.plates[k].marker
    left, bottom = (np.concatenate(marker.boundary.outlines()) * 1e3).min(axis=0)
    right = (np.concatenate(marker.boundary.outlines()) * 1e3)[:, 0].max()
    dots = marker.xyz[:, :2] * 1e3

    def freest(middles: Array) -> Array:
        """The one of some places (m, 2) that is farthest from all dots, the first of equal ones."""
        gaps = np.linalg.norm(middles[:, None] - dots, axis=-1).min(axis=-1)
        return np.asarray(middles[int(np.argmax(np.round(gaps, 6)))])

    size, name = NAME * scale, body.plates[k].name
    half = text_width(name, size, "bold") / 2
    quiet = np.array([point.feature.diameter * 1e3 for point in marker.control_points])

    def lowest(x: float) -> float:
        """Lower end of the plate, and of the quiet zones of dots above a name there."""
        above = np.abs(dots[:, 0] - x) < quiet + half
        return float(np.min((dots[:, 1] - quiet)[above], initial=bottom))

    ends = [(x, lowest(x) - 2 * AIR * scale - size) for x in (left + half, right - half)]
    x, low = max(ends, key=lambda end: round(end[1], 6))
    shapes: list[Shape] = [text(name, float(x), low, size, "center", "bold", name="plate-name")]
    for number, edge in enumerate(edges):
        if edge.meets is None:
            continue
        caption, height = f"to {body.plates[edge.meets[0]].name}", LABEL * scale
        reach = np.array([text_width(caption, height) / 2, height / 2])
        aside = edge.outward * (2 * AIR * scale + np.abs(edge.outward) @ reach)
        # In the middle of an edge there may be the tick of an axis, and at an end of the lower one is the name.
        shares = np.array([0.35, 0.65, 0.25, 0.75])[:, None]
        spot = freest(np.array(edge.start) + shares * np.subtract(edge.end, edge.start) + aside)
        label = text(caption, float(spot[0]), float(spot[1]) - height / 2, height, "center", color=GRAY)
        shapes.append(replace(label, name=f"edge-{number}"))
    return tuple(shapes)
