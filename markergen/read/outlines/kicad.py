"""Read the board's outline of a KiCad file: the lines, arcs and shapes on Edge.Cuts, or on another layer that is named.

Those of footprints are placed by their position and angle. Coordinates are in mm, y down.
"""

# tests: tests/read/outlines/test_kicad.py

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import brief
from markergen.read.outlines.curves import Arc, Bezier, Curve, Polyline, bulge
from markergen.read.outlines.formats import (
    MOST_PIECES,
    OUTLINE_FORMATS,
    Drawing,
    OutlineFile,
    OutlineFormat,
    OutlinePiece,
)

EDGE = "Edge.Cuts"
LARGEST_BOARD = 20_000_000
"""Maximum size in bytes: large boards have 10 MB of tracks."""
DEEPEST = 30
"""Maximum nesting; KiCad writes up to eight levels."""

_START = re.compile(rb"\s*\((?:kicad_pcb|footprint|module)\s")
_TOKEN = re.compile(r'[()]|"(?:[^"\\]|\\.)*+"|[^\s()"]++')
_SHAPE = re.compile(r"(?:gr|fp)_(line|arc|circle|rect|poly|curve)")
_OTHER = re.compile(r"(?:gr|fp)_\w+|pad|dimension|target|image")
"""What else may be on a layer, or drill a hole."""

_KEPT = re.compile(r"kicad_pcb|footprint|module|at|layers?|start|end|mid|center|pts|angle|xy")

Node = list[Any]
"""A name, followed by words and further nodes."""


def _read(file: OutlineFile, layer: str | None) -> Drawing:
    pieces: list[OutlinePiece] = []
    others: list[str] = []
    layers: set[str] = set()
    wanted = layer or EDGE
    for node, matrix in _nodes(_parsed(file), np.eye(3)[:2]):
        kind = _SHAPE.fullmatch(node[0])
        names = [name for child in _all(node, "layer") + _all(node, "layers") for name in child[1:]]
        layers.update(names if kind else ())
        if kind is None or wanted not in names:
            is_hole = node[0] == "pad" and "np_thru_hole" in node
            if is_hole or (kind is None and wanted in names):
                others.append("a hole drilled through a pad" if is_hole else f"{node[0]} on {wanted}")
            continue
        if len(pieces) >= MOST_PIECES:
            raise file.too_much(f"at most {MOST_PIECES} lines and arcs")
        name = f"{node[0]} on {brief(wanted)}"
        curves = tuple(curve.mapped(matrix) for curve in _curves(kind[1], node, file, name))
        pieces.append(OutlinePiece(name, curves, kind[1] in CLOSED))
    if layer is not None and layer not in layers:
        raise file.unknown_layer(layer, sorted(layers))
    return Drawing(pieces, 1e-3, y_down=True, others=others if pieces else [*others, f"nothing on {EDGE}"])


def _parsed(file: OutlineFile) -> Node:
    if len(file.data) > LARGEST_BOARD:
        raise file.too_much(f"at most {LARGEST_BOARD // 10**6} MB of a board")
    stack: list[Node] = [[]]
    for match in _TOKEN.finditer(file.text):
        token = match[0]
        if token == "(":
            stack.append([])
        elif token != ")":
            stack[-1].append(token[1:-1] if token[0] == '"' else token)
        elif len(stack) > 1:
            node = stack.pop()
            # Tracks, zones and models take most of a board.
            if len(stack) > 3 or not node or _KEPT.fullmatch(str(node[0])) or _OTHER.fullmatch(str(node[0])):
                stack[-1].append(node)
        if len(stack) > DEEPEST:
            raise file.too_much(f"at most {DEEPEST} levels")
    if len(stack) > 1 or not (stack[0] and isinstance(stack[0][0], list)):
        raise file.damaged("complete parentheses", "some that are not closed")
    return stack[0][0]


def _nodes(node: Node, matrix: Array) -> Iterator[tuple[Node, Array]]:
    """What is drawn on a board or footprint, each with its map (2, 3) to the board."""
    for child in node[1:]:
        if not isinstance(child, list) or not child or not isinstance(child[0], str):
            continue
        if _OTHER.fullmatch(child[0]):
            yield child, matrix
        elif child[0] in ("footprint", "module"):
            x, y, angle = (_numbers(child, "at") + [0.0, 0.0, 0.0])[:3]
            c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
            # Angles are counterclockwise on the screen, where y is down.
            yield from _nodes(child, np.array([[c, s, x], [-s, c, y]]))


def _all(node: Node, key: str) -> list[Node]:
    return [child for child in node[1:] if isinstance(child, list) and child and child[0] == key]


def _numbers(node: Node, key: str) -> list[float]:
    try:
        return [float(word) for child in _all(node, key)[:1] for word in child[1:] if isinstance(word, str)]
    except ValueError:
        return []


def _points(node: Node, file: OutlineFile, name: str, *keys: str) -> Array:
    """Points (k, 2) under keys."""
    numbers = [_numbers(node, key) for key in keys]
    for key, point in zip(keys, numbers, strict=True):
        if len(point) != 2:
            raise file.unreadable(f"{key} with x and y", f"another for {name}", "save it again")
    return np.array(numbers)


def _curves(kind: str, node: Node, file: OutlineFile, name: str) -> list[Curve]:
    """Curves of a shape, one after the other."""
    if kind == "poly":
        children = [child for points in _all(node, "pts") for child in points[1:] if isinstance(child, list)]
        if not children or any(child[0] not in ("arc", "xy") for child in children):
            raise file.unreadable("points xy and arcs", f"others or none for {name}", "save it again")
        return [curve for child in children for curve in _curves(child[0], child, file, name)]
    if kind == "xy":
        return [Polyline(_points(["", node], file, name, "xy"))]
    if kind == "curve":
        points = [_points(["", child], file, name, "xy")[0] for pts in _all(node, "pts") for child in _all(pts, "xy")]
        if len(points) != 4:
            raise file.unreadable("four points of a curve", f"{len(points)} for {name}", "save it again")
        return [Bezier(np.array(points))]
    start, end = ends = _points(node, file, name, "center" if kind == "circle" else "start", "end")
    if kind == "line":
        return [Polyline(ends)]
    if kind == "rect":
        return [Polyline(np.array([start, [end[0], start[1]], end, [start[0], end[1]]]))]
    if kind == "circle":
        radius = float(np.hypot(*(end - start)))
        return [Arc(start, np.array([radius, 0.0]), np.array([0.0, radius]))]
    if angle := _numbers(node, "angle"):
        # Until KiCad 5: the center, the first point, and an angle that is clockwise on the screen.
        u = end - start
        return [Arc(start, u, np.array([-u[1], u[0]]), 0.0, float(np.radians(angle[0])))]
    (middle,) = _points(node, file, name, "mid")
    # Half the sweep is twice the angle at the start between the chord and the middle.
    to_middle, to_end = middle - start, end - middle
    quarter = np.arctan2(to_middle[0] * to_end[1] - to_middle[1] * to_end[0], to_middle @ to_end) / 2
    return [bulge(start, end, float(np.tan(quarter)))]


CLOSED = ("circle", "rect", "poly")
"""Kinds of shapes whose end is joined to their start."""

OUTLINE_FORMATS.register("kicad")(
    OutlineFormat("(kicad_pcb with Edge.Cuts", lambda file: _START.match(file.data) is not None, _read)
)
