"""Curves of DXF's entities, in their own coordinate systems."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.read.outlines.curves import Arc, Curve, Polyline, Spline, bulge
from markergen.read.outlines.drawing import MOST_PIECES, OutlineFile

Array = NDArray[np.float64]
Parts = Iterator[tuple[list[Curve], bool]]
"""Curves one after the other, and whether the last is joined to the first."""

HIGHEST_DEGREE = 11
MOST_FIT_POINTS = 500
"""ezdxf solves for the curve through them with a full matrix: 10,000 take 2 GB and half a minute."""

_RAISED = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 0]])


def frame_of(entity: Any) -> Array:
    """Map (3, 4) of an entity's coordinates to those of the drawing; only some kinds have a system of their own."""
    planar = entity.dxftype() in ("ARC", "CIRCLE", "LWPOLYLINE")
    if not planar and not (entity.dxftype() == "POLYLINE" and entity.is_2d_polyline):
        return np.eye(4)[:3]
    ocs = entity.ocs()
    return np.column_stack([np.array([ocs.ux, ocs.uy, ocs.uz], dtype=float).T, np.zeros(3)])


def _line(entity: Any, file: OutlineFile, name: str) -> Parts:
    del file, name
    yield [Polyline(np.array([entity.dxf.start, entity.dxf.end], dtype=float))], False


def _circle(entity: Any, file: OutlineFile, name: str) -> Parts:
    del file, name
    center, u, v = _round(entity)
    yield [Arc(center, u, v)], True


def _arc(entity: Any, file: OutlineFile, name: str) -> Parts:
    del file, name
    center, u, v = _round(entity)
    start, end = np.radians(float(entity.dxf.start_angle)), np.radians(float(entity.dxf.end_angle))
    yield [Arc(center, u, v, float(start), _turn(start, end))], False


def _ellipse(entity: Any, file: OutlineFile, name: str) -> Parts:
    del file, name
    u = np.array(entity.dxf.major_axis, dtype=float)
    normal = np.array(entity.dxf.extrusion, dtype=float)
    v = np.cross(normal / np.linalg.norm(normal), u) * float(entity.dxf.ratio)
    start, end = float(entity.dxf.start_param), float(entity.dxf.end_param)
    turn = _turn(start, end)
    # A whole one is written as 0 to 2 pi, with as many digits as the program likes.
    whole = abs(turn - 2 * np.pi) < 1e-6
    yield [Arc(np.array(entity.dxf.center, dtype=float), u, v, start, 2 * np.pi if whole else turn)], whole


def _lwpolyline(entity: Any, file: OutlineFile, name: str) -> Parts:
    del name
    rows = np.array(list(entity.get_points("xyb")), dtype=float).reshape(-1, 3)
    yield _bulged(rows, float(entity.dxf.elevation), bool(entity.closed), file), bool(entity.closed)


def _polyline(entity: Any, file: OutlineFile, name: str) -> Parts:
    if entity.is_poly_face_mesh or entity.is_polygon_mesh:
        raise file.unreadable("a flat outline", f"a mesh as {name}", "draw its outline, or choose another --layer")
    # Control points of a curve that the other vertices follow.
    vertices = [vertex for vertex in entity.vertices if not int(vertex.dxf.flags) & 16]
    points = np.array([vertex.dxf.location for vertex in vertices], dtype=float).reshape(-1, 3)
    closed = bool(entity.is_closed)
    if not len(points):
        return
    if entity.is_2d_polyline:
        bulges = [float(vertex.dxf.get("bulge", 0.0)) for vertex in vertices]
        height = float(entity.dxf.elevation[2]) if entity.dxf.hasattr("elevation") else 0.0
        yield _bulged(np.column_stack([points[:, :2], bulges]), height, closed, file), closed
    else:
        yield [Polyline(points)], closed


def _spline(entity: Any, file: OutlineFile, name: str) -> Parts:
    count = max(entity.control_point_count(), entity.fit_point_count(), entity.knot_count())
    if count > MOST_PIECES:
        raise file.too_much(f"splines of at most {MOST_PIECES} points")
    if entity.control_point_count():
        points = np.array(list(entity.control_points), dtype=float).reshape(-1, 3)
        knots = np.array(list(entity.knots), dtype=float)
        weights = np.array(list(entity.weights), dtype=float)
        degree = int(entity.dxf.degree)
    else:  # Points on the curve alone: the curve that AutoCAD lays through them.
        if count > MOST_FIT_POINTS:
            raise file.too_much(f"splines through at most {MOST_FIT_POINTS} points")
        tool = entity.construction_tool()
        points = np.array(list(tool.control_points), dtype=float).reshape(-1, 3)
        knots, weights, degree = np.array(tool.knots(), dtype=float), np.empty(0), int(tool.degree)
    weights = weights if len(weights) else np.ones(len(points))
    sound = (
        1 <= degree <= HIGHEST_DEGREE
        and len(points) > degree
        and len(knots) == len(points) + degree + 1
        and len(weights) == len(points)
        and all(np.isfinite(array).all() for array in (points, knots, weights))
        and bool((np.diff(knots) >= 0).all())
        and knots[degree] < knots[len(points)]
        and bool((weights > 0).all())
    )
    if not sound:
        raise file.unreadable(
            "a spline that is one",
            f"a degree above {HIGHEST_DEGREE}, or points, knots and weights at odds in {name}",
            "write it again",
        )
    yield [Spline(points, weights, knots, degree)], False


def _bulged(rows: Array, height: float, closed: bool, file: OutlineFile) -> list[Curve]:
    """Curves in space of vertices (x, y, bulge), the bulge being of the step to the next one."""
    if len(rows) > MOST_PIECES:
        raise file.too_much(f"polylines of at most {MOST_PIECES} points")
    lift = np.column_stack([_RAISED[:, :2], [0.0, 0.0, height]])
    if not rows[:, 2].any():
        return [Polyline(rows[:, :2]).mapped(lift)]
    ends = np.roll(rows, -1, axis=0) if closed else rows[1:]
    steps = zip(rows[: len(ends)], ends, strict=True)
    return [bulge(start[:2], end[:2], float(start[2])).mapped(lift) for start, end in steps]


def _round(entity: Any) -> tuple[Array, Array, Array]:
    radius = float(entity.dxf.radius)
    return np.array(entity.dxf.center, dtype=float), np.array([radius, 0.0, 0.0]), np.array([0.0, radius, 0.0])


def _turn(start: float, end: float) -> float:
    """Angle from start to end, counterclockwise, above 0 and at most a whole turn."""
    return float(2 * np.pi - (start - end) % (2 * np.pi))


CURVES: dict[str, Callable[[Any, OutlineFile, str], Parts]] = {
    "LINE": _line,
    "CIRCLE": _circle,
    "ARC": _arc,
    "ELLIPSE": _ellipse,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "SPLINE": _spline,
}
"""Curves of each kind of entity; what is not here is no outline."""
