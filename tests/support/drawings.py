"""Drawings to read, and what their outlines enclose, by other means than the readers'."""

import io
import json
import math
from pathlib import Path

import numpy as np
import shapely

from markergen.geometry.outlines import polygons_of
from markergen.read.outlines.boundary import read_contours

DATA = Path(__file__).parents[1] / "read" / "data"
# 200 x 100 mm with corners of radius 10 mm; a hole of 40 mm across, four of 6 mm.
PLATE = 0.2 * 0.1 - (4 - math.pi) * 0.01**2
HOLED = PLATE - math.pi * 0.02**2 - 4 * math.pi * 0.003**2


def area(rings):
    return sum(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 for x, y in (ring.T for ring in rings))


def region(rings):
    """The region by other means: symmetric difference is what even-odd means."""
    shape = shapely.Polygon()
    for ring in rings:
        shape = shape.symmetric_difference(shapely.Polygon(ring))
    return shape


def svg(body, frame='width="200mm" height="100mm" viewBox="0 0 200 100"'):
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" {frame}>{body}</svg>'
    )


def dxf(draw, unit=4, version="R2010"):
    """Text of a DXF that `draw` puts entities into."""
    import ezdxf

    document = ezdxf.new(version)
    document.units = unit
    draw(document, document.modelspace())
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def geojson(*rings):
    return json.dumps({"type": "Polygon", "coordinates": rings})


SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]


# An editor's outline of 0.6 m, 4.5 um off at most, is this much off in area; Beziers for corners differ by 2.7e-4 r.
AREA_ERROR = 0.73 * 5e-6 + 2 * math.pi * 0.01 * 2.8e-6


def bounds(rings):
    points = np.concatenate(rings) * 1e3
    return np.round([*points.min(axis=0), *points.max(axis=0)], 6).tolist()


def farthest(points, polyline):
    """Largest distance of points from a polyline, by shapely."""
    # GEOS makes nan of segments shorter than the smallest normal number.
    polyline = np.round(polyline, 14)
    if not np.ptp(polyline, axis=0).any():
        return float(np.hypot(*(points - polyline[0]).T).max())
    return float(shapely.distance(shapely.points(points), shapely.LineString(polyline)).max())


def read_outline(path, unit=None, layer=None):
    """Closed outlines of a file as polygons."""
    return polygons_of(read_contours(path, unit, layer))
