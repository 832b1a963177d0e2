"""Distances of points to what is drawn, mm."""

from math import hypot

import numpy as np

from markergen.drawing.scene import Line


def segment_distance(point: np.ndarray, line: Line) -> float:
    """Smallest distance of a point to the stroke's axis."""
    starts, ends = np.array(line.points[:-1]), np.array(line.points[1:])
    way = ends - starts
    t = np.clip(np.sum((point - starts) * way, axis=1) / np.sum(way**2, axis=1), 0, 1)
    return float(np.min(np.linalg.norm(starts + t[:, None] * way - point, axis=1)))


def box_distance(points: np.ndarray, box: tuple) -> float:
    """Smallest distance of points (..., 2) to a box; 0 inside."""
    if points.ndim == 1:  # Without NumPy, which takes longer for two numbers.
        x, y = points
        return hypot(max(box[0] - x, x - box[2], 0.0), max(box[1] - y, y - box[3], 0.0))
    beyond = np.maximum(np.maximum(np.array(box[:2]) - points, points - np.array(box[2:])), 0)
    return float(np.min(np.hypot(beyond[..., 0], beyond[..., 1])))
