"""Markers with a pattern that is given instead of searched for: boards that people own, and points of their own."""
# tests: tests/model/test_boards.py

import re
from collections.abc import Sequence
from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.model.boundary import Circle, Polygon
from markergen.model.feature import Feature
from markergen.model.marker import Marker, build_marker
from markergen.units import format_length, parse_length

Length = float | str

SHARE = 0.5
"""Default diameter of a dot over the pitch, as ROS-Industrial's generator draws them."""

CLEARANCE = 0.1
"""Clearance of a board's dots over their diameter, as of a design."""

ROUNDING = 1e-9
"""Overlap of dots in m that rounding explains, as a marker.json may have."""

_SIZE = re.compile(r"\s*(\d+)\s*x\s*(\d+)\s*(asymmetric)?\s*")


def grid(size: str, pitch: Length, dot: Length | None = None, origin_dot: Length | None = None) -> Marker:
    """See `Marker.grid`."""
    columns, rows, is_asymmetric = _parsed(size, "4x11 asymmetric or 7x5")
    step = _above_zero(pitch, "pitch")
    points = step * unit_grid(columns, rows, is_asymmetric)
    marker = from_points(points, SHARE * step if dot is None else dot)
    if origin_dot is None:
        return marker
    corner = columns * (rows - 1)
    marker = from_points(points - points[corner], marker.dot_diameter)
    feature = Feature(parse_length(origin_dot, "origin_dot"))
    dots = (replace(point, feature=feature) if point.id == corner else point for point in marker.control_points)
    return replace(marker, control_points=tuple(dots))


def hexagonal(size: str, pitch: Length, dot: Length | None = None) -> Marker:
    """See `Marker.hexagonal`."""
    columns, rows, _ = _parsed(size, "7x5")
    step = _above_zero(pitch, "pitch")
    row, column = np.divmod(np.arange(columns * rows), columns)
    points = step * np.stack([column + row % 2 / 2, -row * sqrt(3) / 2], axis=-1)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return from_points(points - middle, SHARE * step if dot is None else dot)


def circles(rings: Sequence[tuple[int, Length]], dot: Length) -> Marker:
    """See `Marker.circles`."""
    try:
        counts, radii = zip(*((int(count), parse_length(radius, "radius")) for count, radius in rings), strict=True)
    except (TypeError, ValueError):
        remedy = 'write for example [(6, "40mm"), (12, "80mm")]'
        raise InputError("pairs of a number of dots and a radius", brief(rings), remedy) from None
    if min(radii) < 0 or min(counts) < 1:
        raise InputError("rings of one dot or more, with radii of 0 or more", brief(rings), "correct the pair")
    turns = np.concatenate([2 * np.pi * np.arange(count) / count for count in counts])
    points = np.repeat(radii, counts)[:, None] * np.stack([-np.sin(turns), np.cos(turns)], axis=-1)
    marker = from_points(points, dot)
    return replace(marker, boundary=Circle(max(radii) + (0.5 + CLEARANCE) * marker.dot_diameter))


def from_points(points: Any, dot: Length) -> Marker:
    """See `Marker.from_points`."""
    from scipy.spatial.distance import pdist

    diameter = _above_zero(dot, "dot")
    try:
        places = np.round(np.array(points, dtype=float), 12) + 0.0
    except (TypeError, ValueError):
        remedy = "give numbers, x and y of each dot in its row"
        raise InputError("points (n, 2 or 3) in m", brief(points), remedy) from None
    if places.ndim != 2 or places.shape[1] not in (2, 3) or len(places) < 4:
        expected = "points (n, 2 or 3) in m, four or more"
        raise InputError(expected, f"an array {places.shape}", "give x and y of each dot in its row")
    if not np.isfinite(places).all():
        raise InputError("finite numbers in m", "others", "give x and y of each dot in its row")
    nearest = pdist(places[:, :2]).min()
    if nearest < diameter - ROUNDING:
        actual = f"centers {format_length(nearest)} apart for dots of {format_length(diameter)}"
        raise InputError("dots that do not overlap", actual, "move them apart, or make them smaller")
    edge = (0.5 + CLEARANCE) * diameter
    (left, low), (right, high) = places[:, :2].min(axis=0) - edge, places[:, :2].max(axis=0) + edge
    room = Polygon((((right, high), (left, high), (left, low), (right, low)),))
    return build_marker(places, room, diameter, CLEARANCE * diameter, keyed=False)


def _above_zero(value: Length, name: str) -> float:
    length = parse_length(value, name)
    if not length > 0:
        raise InputError(f"a {name} above 0", f"{name}={brief(value)}", "give such as 10mm")
    return length


def unit_grid(columns: int, rows: int, asymmetric: bool) -> Array:
    """Centers (columns rows, 2) about the origin with y up; neighbors along a row are 1 apart, asymmetric ones 2.

    As in OpenCV, every other row of an asymmetric grid is displaced by half of that distance, to the right.
    """
    row, column = np.divmod(np.arange(columns * rows), columns)
    x = 2 * column + row % 2 if asymmetric else column
    place = np.stack([x, -row], axis=-1).astype(float)
    return place - (place.min(axis=0) + place.max(axis=0)) / 2


def _parsed(size: str, example: str) -> tuple[int, int, bool]:
    match = _SIZE.fullmatch(str(size))
    if match is None or int(match[1]) * int(match[2]) < 4:
        raise InputError("columns x rows of 4 dots or more", brief(size), f"write for example {example}")
    return int(match[1]), int(match[2]), bool(match[3])
