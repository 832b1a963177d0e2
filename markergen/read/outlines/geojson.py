"""Read polygons of a GeoJSON file, also in collections."""

# tests: tests/read/outlines/test_files.py

import json
from collections.abc import Sequence
from itertools import count
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.geometry.contour import Contour
from markergen.geometry.outlines import polygons_of
from markergen.model.json_text import parsed
from markergen.read.outlines.curves import Polyline
from markergen.read.outlines.formats import (
    MOST_PIECES,
    OUTLINE_FORMATS,
    Drawing,
    OutlineFile,
    OutlineFormat,
    OutlinePiece,
)

LARGEST_JSON = 3_000_000
"""Maximum size in bytes; each byte takes 40 in memory."""

KEYS = ("type", "features", "geometries", "geometry", "coordinates", "properties", "bbox", "id", "name")
"""Keys that are read or do not change a shape."""


def _read(file: OutlineFile, layer: str | None) -> Drawing:
    """Drawing of all polygons, in a unit that GeoJSON does not specify."""
    if layer is not None:
        raise file.unknown_layer(layer, [])
    if len(file.data) > LARGEST_JSON:
        raise file.too_much(f"at most {LARGEST_JSON // 10**6} MB of GeoJSON")
    pieces: list[OutlinePiece] = []
    others: list[str] = []
    todo: list[tuple[Any, str]] = [(parsed(file.text, file.name), "file")]
    for steps in count(1):
        if not todo:
            break
        node, name = todo.pop()
        if steps > MOST_PIECES:
            raise file.too_much(f"at most {MOST_PIECES} polygons")
        if not isinstance(node, dict):
            raise file.unreadable("a GeoJSON object", f"{name}: {brief(node)}", "correct the file")
        others += [f"the key {key}" for key in node if key not in KEYS]
        kind = node.get("type")
        if kind in ("FeatureCollection", "GeometryCollection"):
            key = "features" if kind == "FeatureCollection" else "geometries"
            # Reversed, since the last is taken first.
            todo += _items(file, node.get(key), f"{name}.{key}")[::-1]
        elif kind == "Feature":
            if node.get("geometry") is not None:  # A feature without a geometry has null.
                todo.append((node["geometry"], f"{name}.geometry"))
        elif kind in ("Polygon", "MultiPolygon"):
            place, parts = f"{name}.coordinates", node.get("coordinates")
            polygons = [(parts, place)] if kind == "Polygon" else _items(file, parts, place)
            rings = [ring for polygon in polygons for ring in _items(file, *polygon)]
            pieces += [_piece(file, *ring) for ring in rings if ring[0] != []]
        elif kind in ("Point", "MultiPoint", "LineString", "MultiLineString"):
            others.append(kind)
        else:
            raise file.unreadable("a GeoJSON type", f"{name}.type {brief(kind)}", "correct the file")
    return Drawing(pieces, None, others=others, hint="; longitude and latitude are not lengths: export them in m")


def _piece(file: OutlineFile, ring: Any, name: str) -> OutlinePiece:
    # A third number is a height; booleans are numbers only to Python.
    if not isinstance(ring, list) or not all(
        isinstance(position, list) and len(position) >= 2 and all(type(x) in (int, float) for x in position)
        for position in ring
    ):
        raise file.unreadable("pairs of numbers [x, y]", f"others at {name}", "correct the file")
    points = np.array([position[:2] for position in ring], dtype=float).reshape(-1, 2)
    # Rings repeat their first position; a ring that does not is open, and reported like any other gap.
    return OutlinePiece(name, (Polyline(points),), False)


def _items(file: OutlineFile, value: Any, name: str) -> list[tuple[Any, str]]:
    if not isinstance(value, list):
        raise file.unreadable("a list", f"{name}: {brief(value)}", "correct the file")
    if len(value) > MOST_PIECES:
        raise file.too_much(f"at most {MOST_PIECES} polygons")
    return [(item, f"{name}[{i}]") for i, item in enumerate(value)]


def _write(contours: Sequence[Contour], _: str) -> str:
    if any(contour.has_arcs for contour in contours):
        raise InputError("an outline without arcs for GeoJSON", "arcs", "write .svg or .dxf, which have them")
    rings = [[*ring.tolist(), ring[0].tolist()] for ring in polygons_of(contours)]
    return json.dumps({"type": "Polygon", "coordinates": rings}) + "\n"


OUTLINE_FORMATS.register("geojson")(
    OutlineFormat(
        "JSON with a type such as Polygon or FeatureCollection",
        lambda file: file.data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"["),
        _read,
        (".geojson",),
        _write,
    )
)
