"""Meshes of a GLB: glTF 2.0 in one binary file."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.guard import MOST_TRIANGLES
from markergen.read.meshes import LONGEST, MOST_OBJECTS, Color, MeshObject

Array = NDArray[np.float64]

MOST_NODES, DEEPEST = 20_000, 50

LARGEST_JSON = 10_000_000
"""Maximum size in bytes of the text in a GLB: 15,000 parts."""

INTEGERS = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
FLOAT, TRIANGLES = 5126, 4
"""Types of numbers and of primitives in a glTF."""

FRAME = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Rotation from glTF's axes (y up, z toward the viewer) to those of simulators and of the marker (z up)."""


def read_glb(data: bytes) -> list[MeshObject]:
    """Read the meshes of a GLB's scene, in mm, marker frame; the primitives of a mesh differ in material."""
    document, binary = _glb_parts(data)
    try:
        nodes = list(_glb_nodes(document))
        counts = [_glb_count(document, each) for node, _ in nodes for each in _glb_primitives(document, node)]
        if sum(counts) > MOST_TRIANGLES:
            raise InputError(f"at most {MOST_TRIANGLES} triangles", str(sum(counts)), "export the marker alone")
        if len(counts) > MOST_OBJECTS:
            raise InputError(f"at most {MOST_OBJECTS} meshes", str(len(counts)), "export the marker alone")
        meshes = [_glb_mesh(document, binary, node, matrix) for node, matrix in nodes if "mesh" in node]
    # What Python raises for entries of a document that are missing or of another kind.
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError("a complete GLB", "inconsistent parts", "export it again") from None
    return [each for each in meshes if len(each.corners)]


def _glb_parts(data: bytes) -> tuple[dict[str, Any], memoryview]:
    """Document and binary buffer of a GLB; raises InputError if it is none, or not one file on its own."""
    if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
        raise InputError("a GLB of glTF 2.0", brief(repr(data[:8])), "export it again")
    if int.from_bytes(data[8:12], "little") != len(data):
        raise InputError("a complete GLB", f"{len(data)} bytes", "export it again")
    size = int.from_bytes(data[12:16], "little")
    if size > LARGEST_JSON:
        raise InputError(f"at most {LARGEST_JSON // 10**6} MB of text in a GLB", "more", "export the marker alone")
    try:
        document = json.loads(data[20 : 20 + size])
        if required := document.get("extensionsRequired"):
            raise InputError("a GLB without extensions", brief(str(required)), "export it without them")
        if any("uri" in each for each in document.get("buffers", [])):
            raise InputError("one file", "a buffer in another file", "export it as one GLB")
    except (TypeError, ValueError, AttributeError, RecursionError):
        raise InputError("a complete GLB", "inconsistent parts", "export it again") from None
    start = 20 + size
    return document, memoryview(data)[start + 8 : start + 8 + int.from_bytes(data[start : start + 4], "little")]


def _at(entries: list[Any], index: int) -> Any:
    """Entry of a list; Python would count negative indices from the end."""
    if not (isinstance(index, int) and index >= 0):
        raise IndexError(index)
    return entries[index]


def _glb_nodes(document: dict[str, Any]) -> Iterator[tuple[dict[str, Any], Array]]:
    """Nodes of the scene with their matrices (4, 4), for column vectors."""
    scene = _at(document["scenes"], document.get("scene", 0))
    todo = [(index, np.eye(4), 0) for index in scene["nodes"]]
    for index, matrix, depth in todo:
        if depth > DEEPEST or len(todo) > MOST_NODES:
            raise InputError(f"at most {MOST_NODES} nodes", "more, or a cycle", "check it")
        node = _at(document["nodes"], index)
        here = matrix @ _glb_matrix(node)
        todo += [(child, here, depth + 1) for child in node.get("children", [])]
        yield node, here


def _glb_matrix(node: dict[str, Any]) -> Array:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=float)
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] = np.array(turn) * np.array(node.get("scale", (1, 1, 1)), dtype=float)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=float)
    return matrix


def _glb_primitives(document: dict[str, Any], node: dict[str, Any]) -> list[dict[str, Any]]:
    primitives = _at(document["meshes"], node["mesh"])["primitives"] if "mesh" in node else []
    return [each for each in primitives if each.get("mode", TRIANGLES) == TRIANGLES]


def _glb_count(document: dict[str, Any], primitive: dict[str, Any]) -> int:
    """Number of triangles of a primitive, at least a third of the number of its corners."""
    attributes = primitive["attributes"]
    counts = []
    for index in (attributes["POSITION"], primitive.get("indices", attributes["POSITION"])):
        accessor = _at(document["accessors"], index)
        # Before any array is made: each number takes a byte at least.
        if not 0 <= accessor["count"] <= _at(document["bufferViews"], accessor["bufferView"])["byteLength"]:
            raise ValueError(accessor)
        counts.append(int(accessor["count"]))
    return max(counts) // 3


def _glb_mesh(document: dict[str, Any], binary: memoryview, node: dict[str, Any], matrix: Array) -> MeshObject:
    corners, paints = [np.zeros((0, 3, 3))], [np.zeros(0, dtype=np.int64)]
    palette: list[Color | None] = []
    for primitive in _glb_primitives(document, node):
        places = _glb_array(document, binary, primitive["attributes"]["POSITION"], 3)
        indices = primitive.get("indices")
        order = np.arange(len(places)) if indices is None else _glb_array(document, binary, indices, 1).astype(np.int64)
        faces = order.reshape(-1, 3)
        moved = 1e3 * (places @ matrix[:3, :3].T + matrix[:3, 3]) @ FRAME.T
        corners.append(moved[faces if np.linalg.det(matrix[:3, :3]) > 0 else faces[:, ::-1]])
        paints.append(np.full(len(faces), len(palette)))
        palette.append(_glb_color(document, primitive))
    every, paint, name = np.concatenate(corners), np.concatenate(paints), str(node.get("name", ""))[:LONGEST]
    # Most triangles determine the color of the part.
    main = int(np.argmax(np.bincount(paint, minlength=1)))
    colors = [color for color in palette if color is not None]
    if len(colors) < len(palette) or not colors:
        return MeshObject(every, name, palette[main] if palette else None)
    return MeshObject(every, name, palette[main], np.where(paint == main, -1, paint), colors)


def _glb_array(document: dict[str, Any], binary: memoryview, index: int, width: int) -> NDArray[Any]:
    """Numbers (count, width) of an accessor."""
    accessor = _at(document["accessors"], index)
    kind = "<f4" if width > 1 else INTEGERS[accessor["componentType"]]
    if accessor["type"] != ("VEC3" if width > 1 else "SCALAR") or "sparse" in accessor:
        raise ValueError(accessor["type"])
    if width > 1 and accessor["componentType"] != FLOAT:
        raise ValueError(accessor["componentType"])
    view = _at(document["bufferViews"], accessor["bufferView"])
    size = np.dtype(kind).itemsize * width
    start, inner, step = view.get("byteOffset", 0), accessor.get("byteOffset", 0), view.get("byteStride", size)
    if view["buffer"] != 0 or min(start, inner, view["byteLength"]) < 0 or step < size:
        raise ValueError(view)
    inside = binary[start : start + view["byteLength"]]
    return np.array(np.ndarray((accessor["count"], width), kind, inside, inner, (step, size // width)))


def _glb_color(document: dict[str, Any], primitive: dict[str, Any]) -> Color | None:
    if "material" not in primitive:
        return None
    material = _at(document["materials"], primitive["material"])
    factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", (1, 1, 1, 1))
    red, green, blue = (float(each) for each in factor[:3])
    return red, green, blue
