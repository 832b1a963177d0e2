"""Which share of each pixel a shape covers: exact for straight edges, of which curves get as many as that takes."""

from dataclasses import dataclass
from math import acos, ceil, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.scene import Disk, FilledPath, Line, Shape

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SAGITTA = 2e-3
"""How far in pixels a chord may lie off its curve; a grey level is 4e-3 of a pixel."""
FEWEST_ARCS = 32
MITER = 4.0
"""Longest miter in widths, as in SVG; beyond it a corner is beveled."""
FAINT = 1e-3
"""Share of a pixel below which nothing is painted; half a grey level is 2e-3."""


@dataclass(frozen=True)
class Spans:
    """Runs of pixels that a shape covers evenly, in raster order.

    Attributes
    ----------
    row, column, length : array (s,)
        Where each begins, and of how many pixels it is.
    share : array (s,)
        Of each pixel that is covered, 0 to 1.
    """

    row: Index
    column: Index
    length: Index
    share: Array


def spans(shape: Shape, per_mm: float, page_height: float, width: int, height: int) -> Spans:
    """Pixels (height, width) that a shape covers, the page's top left corner being that of the raster.

    The signed area to the right of every edge within a pixel, summed along the row, is the winding number times the
    covered share; shapes that overlap themselves (glyphs do) count once.

    Parameters
    ----------
    shape : Shape
        In mm, y up.
    per_mm : float
        Pixels per mm.
    page_height : float
        mm.
    width, height : int
        Of the raster in pixels.
    """
    edges = _edges(shape, per_mm) * [per_mm, -per_mm, per_mm, -per_mm] + [0.0, per_mm * page_height] * 2
    row, column, rise, inside = _cells(edges)
    on_raster = (row >= 0) & (row < height) & (rise != 0)
    row, column, rise, inside = row[on_raster], column[on_raster], rise[on_raster], inside[on_raster]
    # What lies left of the raster covers all to the right of it, what lies right of it nothing.
    inside = np.where(column < 0, 1.0, np.where(column >= width, 0.0, inside))
    column = np.clip(column, 0, width)
    stride = width + 2
    keys = np.concatenate([row * stride + column, row * stride + column + 1])
    areas = np.concatenate([rise * inside, rise * (1 - inside)])
    if not len(keys):
        none = np.zeros(0, dtype=np.int64)
        return Spans(none, none, none, np.zeros(0))
    order = np.argsort(keys, kind="stable")
    keys, areas = keys[order], areas[order]
    first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    starts = keys[first]
    # Every row closes by itself, so one running sum serves them all.
    share = np.minimum(np.abs(np.cumsum(np.add.reduceat(areas, first))), 1.0)
    ends = np.append(starts[1:], starts[-1])
    row, column = np.divmod(starts, stride)
    length = np.minimum(ends - starts, width - column)
    kept = (share > FAINT) & (length > 0)
    return Spans(row[kept], column[kept], length[kept], share[kept])


def _cells(edges: Array) -> tuple[Index, Index, Array, Array]:
    """Cut edges (m, 4) at all pixel borders; of each piece its row, column, rise, and mean share right of it."""
    x0, y0, x1, y1 = edges.T
    pieces = []
    for start, end in ((x0, x1), (y0, y1)):
        low = np.floor(np.minimum(start, end)).astype(np.int64) + 1
        count = np.maximum(np.ceil(np.maximum(start, end)).astype(np.int64) - low, 0)
        edge = np.repeat(np.arange(len(edges)), count)
        border = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + low[edge]
        pieces.append((edge, (border - start[edge]) / (end - start)[edge]))
    every = np.arange(len(edges))
    edge = np.concatenate([every, pieces[0][0], pieces[1][0]])
    begin = np.concatenate([np.zeros(len(edges)), pieces[0][1], pieces[1][1]])
    order = np.lexsort((begin, edge))
    edge, begin = edge[order], begin[order]
    end = np.append(begin[1:], 1.0)
    end[np.append(edge[1:] != edge[:-1], True)] = 1.0
    dx, dy = (x1 - x0)[edge], (y1 - y0)[edge]
    middle = (begin + end) / 2
    x, y = x0[edge] + middle * dx, y0[edge] + middle * dy
    column, row = np.floor(x), np.floor(y)
    return row.astype(np.int64), column.astype(np.int64), (end - begin) * dy, 1 - (x - column)


def _edges(shape: Shape, per_mm: float) -> Array:
    """Straight edges (m, 4) of closed polygons in mm: x0, y0, x1, y1."""
    match shape:
        case Disk():
            center = np.array([shape.x, shape.y])
            rings = [_circle(shape.radius, per_mm) + center]
            if shape.inner_radius:
                rings.append(_circle(shape.inner_radius, per_mm)[::-1] + center)
            return np.concatenate([_closed(ring) for ring in rings])
        case Line():
            return np.concatenate([_closed(ring) for ring in _stroke(shape)])
        case FilledPath():
            return _flattened(shape, per_mm)


def _closed(ring: Array) -> Array:
    return np.concatenate([ring, np.roll(ring, -1, axis=0)], axis=-1)


def _circle(radius: float, per_mm: float) -> Array:
    """Regular polygon (k, 2) of the circle's area."""
    flat = min(SAGITTA / (radius * per_mm), 1.0)
    count = max(ceil(pi / acos(1 - flat)), FEWEST_ARCS)
    angle = 2 * pi / count * np.arange(count)
    reach = radius * sqrt(2 * pi / count / sin(2 * pi / count))
    return reach * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _stroke(line: Line) -> list[Array]:
    """Outlines (k, 2) of a stroke with mitered corners; one for an open line, two for a closed one."""
    points = np.array(line.points)
    points = points[np.append(True, np.any(np.diff(points, axis=0) != 0, axis=1))]
    closed = line.closed
    steps = np.diff(points, axis=0)
    normals = np.stack([-steps[:, 1], steps[:, 0]], axis=-1) / np.hypot(*steps.T)[:, None]
    if closed:
        points = points[:-1]
        before, after = np.roll(normals, 1, axis=0), normals
    else:
        before, after = np.concatenate([normals[:1], normals]), np.concatenate([normals, normals[-1:]])
    miter = 1 + np.sum(before * after, axis=1)  # twice the squared cosine of half the turn
    sharp = miter < 2 / MITER**2
    shift = (before + after) / np.where(sharp, 1.0, miter)[:, None]
    # A beveled corner takes two points per side; the others are given twice, which adds no area.
    shifts = np.stack([np.where(sharp[:, None], before, shift), np.where(sharp[:, None], after, shift)], axis=1)
    left, right = ((points[:, None] + side * line.width / 2 * shifts).reshape(-1, 2) for side in (1, -1))
    return [left, right[::-1]] if closed else [np.concatenate([left, right[::-1]])]


def _flattened(outline: FilledPath, per_mm: float) -> Array:
    """Edges (m, 4) of a path with its curves cut into chords, every part of it closed."""
    straight: list[tuple[float, ...]] = []
    curves: dict[str, list[tuple[tuple[float, float], ...]]] = {"Q": [], "C": []}
    start = here = (0.0, 0.0)
    for command, points in outline.segments:
        if command in ("M", "Z"):
            if here != start:
                straight.append((*here, *start))
            start = here = points[0] if points else start
        elif command == "L":
            straight.append((*here, *points[0]))
            here = points[0]
        else:
            curves[command].append((here, *points))
            here = points[-1]
    if here != start:
        straight.append((*here, *start))
    parts = [np.array(straight).reshape(-1, 4)]
    for controls in filter(None, curves.values()):
        parts.append(_chords(np.array(controls), per_mm))
    return np.concatenate(parts)


def _chords(controls: Array, per_mm: float) -> Array:
    """Chords (m, 4) of Bezier curves (k, 3 or 4, 2), as many for each as the most bent one needs."""
    degree = controls.shape[1] - 1
    bend = np.diff(controls, n=2, axis=1)
    # A chord of a curve whose second derivative is at most M is off by at most M / (8 count^2).
    most = degree * (degree - 1) * float(np.hypot(bend[..., 0], bend[..., 1]).max())
    count = max(ceil(sqrt(most * per_mm / (8 * SAGITTA))), 1)
    t = np.linspace(0, 1, count + 1)[:, None]
    points = controls[:, :, None]
    while points.shape[1] > 1:
        points = (1 - t) * points[:, :-1] + t * points[:, 1:]
    walk = points[:, 0]
    return np.concatenate([walk[:, :-1], walk[:, 1:]], axis=-1).reshape(-1, 4)
