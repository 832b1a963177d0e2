"""The marker's outlines on paper: hairlines to cut along by hand, or closed lines that a cutter follows."""

from math import ceil, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.colors import BLACK_ON_WHITE, Colors
from markergen.drawing.figure import Figure
from markergen.drawing.numbers import quiet_radius
from markergen.drawing.scene import Line
from markergen.geometry.contour import flattened
from markergen.geometry.outlines import walked
from markergen.model.boundary import Boundary, Circle

Array = NDArray[np.float64]

HAIRLINE = 0.15
"""Width in mm that a 600 dpi printer still draws whole."""

AIR = 1.0
"""Between an outline and a tick or the center cross, mm."""

TRUE = 5e-4
"""How far in mm a closed line may lie off a circle."""

HEADINGS = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}
"""The axes' four directions."""


def boundary_lines(figure: Figure, colors: Colors) -> list[Line]:
    """Lines along the boundary, and along the keep-outs and the plate's holes in it, mm, marker frame.

    As hairlines they are interrupted where they would cross a quiet zone. With a color of their own for a cutter they
    are closed, for a cutter lets no ink behind.
    """
    marker, closed = figure.marker, colors.cut != BLACK_ON_WHITE.cut
    lines = _lines(figure, marker.boundary, "boundary", colors.cut, closed)
    shapes = [(f"keep-out-{index}", shape) for index, shape in enumerate(marker.keep_outs)]
    shapes += [(f"hole-{index}", hole.bore) for index, hole in enumerate(marker.substrate.holes)]
    for name, shape in shapes:
        lines += _lines(figure, shape, name, colors.cut, closed, marker.boundary)
    return lines


def _lines(
    figure: Figure, shape: Boundary, name: str, color: str, closed: bool, within: Boundary | None = None
) -> list[Line]:
    paths = []
    for contour in shape.contours():
        if (whole := contour.as_circle) is not None:
            x, y, radius = whole
            count = max(ceil(2 * pi * radius * 1e3), ceil(pi * sqrt(radius * 1e3 / (2 * TRUE))), 360)
            paths.append((Circle(radius, (x, y)).rim(count) * 1e3, np.ones(count, dtype=bool)))
        else:
            ring = np.array(flattened(contour, TRUE / 1e3) if contour.has_arcs else contour.points)
            paths.append(walked(ring * 1e3, 1.0))
    runs: list[Array] = []
    for points, corner in paths:
        rim = points * figure.factor
        step = float(np.max(np.hypot(*(np.roll(rim, -1, axis=0) - rim).T)))
        inside = within.depth(points / 1e3) > 0 if within else np.ones(len(rim), dtype=bool)
        # A segment between two points that are half a step clear of a circle cannot cross it.
        free = inside if closed else inside & _clear(rim, figure, step / 2 + HAIRLINE)
        runs += _runs(rim, free, corner)
    return [
        Line(tuple((float(x), float(y)) for x, y in run), HAIRLINE, f"{name}-{index}", color)
        for index, run in enumerate(runs)
    ]


def _clear(points: Array, figure: Figure, spare: float) -> NDArray[np.bool_]:
    free = np.ones(len(points), dtype=bool)
    for dot in figure.dots:
        free &= np.hypot(*(points - (dot.x, dot.y)).T) > quiet_radius(dot) + spare
    return free


def _runs(rim: Array, free: NDArray[np.bool_], corner: NDArray[np.bool_]) -> list[Array]:
    """Parts of a closed line whose points are free, of each the ends and the corners between them."""
    if free.all():
        corners = rim[corner]
        return [np.concatenate([corners, corners[:1]])]
    start = int(np.argmin(free))
    rim, free, corner = np.roll(rim, -start, axis=0), np.roll(free, -start), np.roll(corner, -start)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    runs = []
    for begin, end in edges.reshape(-1, 2):
        kept = corner[begin:end].copy()
        kept[[0, -1]] = True
        if end - begin > 1:
            runs.append(rim[begin:end][kept])
    return runs


def axis_reach(figure: Figure) -> dict[str, float]:
    """How far from the origin in mm the outline reaches along each axis: where ticks may begin.

    What counts is the outline within `AIR` of the axis; where there is none on that side, all of it.
    """
    rings = [np.asarray(ring * 1e3 * figure.factor) for ring in figure.marker.boundary.outlines()]
    reach = {}
    for name, heading in HEADINGS.items():
        along, aside = ([np.asarray(ring @ np.array(axis)) for ring in rings] for axis in (heading, heading[::-1]))
        near = max(_farthest(a, b) for a, b in zip(along, aside, strict=True))
        reach[name] = near if near > 0 else max(float(a.max()) for a in along)
    return reach


def _farthest(along: Array, aside: Array) -> float:
    """Largest `along` of a closed polygon in the strip where `aside` is at most `AIR`; -inf if it misses the strip."""
    start, step = aside, np.roll(aside, -1) - aside
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = np.sort(np.stack([(-AIR - start) / step, (AIR - start) / step]), axis=0)
    level = step == 0
    low = np.where(level, 0.0, np.maximum(crossings[0], 0.0))
    high = np.where(level, 1.0, np.minimum(crossings[1], 1.0))
    hits = (low <= high) & ~(level & (np.abs(start) > AIR))
    ends = along + np.stack([low, high]) * (np.roll(along, -1) - along)
    return float(np.max(ends[:, hits], initial=-np.inf))
