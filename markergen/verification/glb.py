"""GLB: meshes of glTF 2.0 with materials, moved to where its scene has them, in meters."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.model.marker import Marker
from markergen.solid.surface import Color
from markergen.verification.mesh import TOLERANCE, Triangles, surface_of
from markergen.verification.reading import READERS, Reading
from markergen.verification.solids import reading_of

Array = NDArray[np.float64]

JSON, BIN = 0x4E4F534A, 0x004E4942
"""Kinds of chunks."""

TYPES: dict[int, np.dtype[Any]] = {
    5121: np.dtype("<u1"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}

TRIANGLES = 4

MOST_NODES, DEEPEST, MOST_NUMBERS = 20_000, 50, 40_000_000

FRAME = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From glTF's axes, y up and z to the viewer, to those of simulators and of the marker, z up."""


@READERS.register(".glb")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Meshes of a GLB's scene in mm, marker frame."""
    try:
        objects = _Scene(data, name).objects()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
        raise InputError(f"a complete GLB in {name}", "parts that do not fit each other", "export it again") from None
    return reading_of("GLB", surface_of(objects, name), TOLERANCE)


@READERS.register(".sdf", ".urdf")
def read_model(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Refuse a simulator's model: what it shows is in the GLB beside it."""
    raise InputError(
        f"a file with the marker's shape in {name}", "a model of a simulator, which shows a mesh",
        "verify the .glb in the folder meshes beside it",
    )  # fmt: skip


class _Scene:
    """Content of a GLB; what is missing or of another kind raises what Python raises."""

    def __init__(self, data: bytes, name: str) -> None:
        self.name = name
        if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
            raise InputError(f"a GLB of glTF 2.0 in {name}", brief(repr(data[:8])), "export it again")
        if int.from_bytes(data[8:12], "little") != len(data):
            raise InputError(f"a complete GLB in {name}", f"{len(data)} bytes", "export it again")
        chunks: dict[int, bytes] = {}
        at = 12
        while at + 8 <= len(data):
            size, kind = (int.from_bytes(data[at + k : at + k + 4], "little") for k in (0, 4))
            chunks.setdefault(kind, data[at + 8 : at + 8 + size])
            at += 8 + size
        self.gltf: dict[str, Any] = json.loads(chunks[JSON])
        self.binary = chunks.get(BIN, b"")
        required = self.gltf.get("extensionsRequired")
        if required:
            raise InputError(f"a GLB without extensions in {name}", brief(str(required)), "export it plainly")
        self.found: list[Triangles] = []
        self.count = 0

    def objects(self) -> list[Triangles]:
        """Triangles of each primitive that the scene shows."""
        scene = self.gltf["scenes"][self.gltf.get("scene", 0)]
        for node in scene["nodes"]:
            self._follow(node, np.eye(4), 0)
        return self.found

    def _follow(self, index: int, above: Array, depth: int) -> None:
        self.count += 1
        if depth > DEEPEST or self.count > MOST_NODES:
            raise InputError(f"at most {MOST_NODES} nodes in {self.name}", "more, or a circle of them", "check it")
        node = _entry(self.gltf["nodes"], index)
        matrix = above @ _matrix(node)
        if "mesh" in node:
            mesh = _entry(self.gltf["meshes"], node["mesh"])
            self._add(mesh["primitives"], str(node.get("name") or mesh.get("name") or ""), matrix)
        for child in node.get("children", []):
            self._follow(child, matrix, depth + 1)

    def _add(self, primitives: list[dict[str, Any]], name: str, matrix: Array) -> None:
        """One part of all primitives of a mesh: they are its materials."""
        corners, paints, palette = [], [], []
        for number, primitive in enumerate(primitives):
            if primitive.get("mode", TRIANGLES) != TRIANGLES:
                continue
            places = self._numbers(primitive["attributes"]["POSITION"], "VEC3").astype(float)
            if "indices" in primitive:
                order = self._numbers(primitive["indices"], "SCALAR").ravel().astype(np.int64)
            else:
                order = np.arange(len(places))
            moved = (places @ matrix[:3, :3].T + matrix[:3, 3]) @ FRAME.T
            corners.append(1e3 * moved[order].reshape(-1, 3, 3))
            paints.append(np.full(len(corners[-1]), number))
            palette.append(self._color(primitive.get("material")))
        if not corners:
            return
        every, paint = np.concatenate(corners), np.concatenate(paints)
        if np.linalg.det(matrix[:3, :3]) < 0:
            every = every[:, ::-1]
        # The part has the color of most of it.
        main = int(np.argmax(np.bincount(paint)))
        own = palette[main]
        if own is None or None in palette:
            self.found.append(Triangles(every, name, own))
            return
        colors = [color for color in palette if color is not None]
        self.found.append(Triangles(every, name, own, np.where(paint == main, -1, paint), colors))

    def _color(self, index: int | None) -> Color | None:
        if index is None:
            return None
        factor = _entry(self.gltf["materials"], index).get("pbrMetallicRoughness", {}).get("baseColorFactor", [1.0] * 4)
        red, green, blue = (float(value) for value in factor[:3])
        return red, green, blue

    def _numbers(self, index: int, kind: str) -> NDArray[Any]:
        """Numbers (count, width) of an accessor."""
        accessor = _entry(self.gltf["accessors"], index)
        if accessor["type"] != kind or "sparse" in accessor:
            raise ValueError(kind)
        view = _entry(self.gltf["bufferViews"], accessor["bufferView"])
        if view.get("buffer", 0) != 0 or "uri" in self.gltf["buffers"][0]:
            raise InputError(f"one file in {self.name}", "a buffer beside it", "export it as one GLB")
        dtype, width, count = TYPES[accessor["componentType"]], {"VEC3": 3, "SCALAR": 1}[kind], accessor["count"]
        if (dtype.kind == "f") != (kind == "VEC3") or not 0 <= count * width <= MOST_NUMBERS:
            raise ValueError(kind)
        start, size = view.get("byteOffset", 0) + accessor.get("byteOffset", 0), dtype.itemsize * width
        stride = view.get("byteStride") or size
        if start < 0 or stride < size or start + stride * (count - 1) + size > len(self.binary):
            raise ValueError(kind)
        return np.ndarray((count, width), dtype, self.binary, start, (stride, dtype.itemsize))


def _entry(entries: list[dict[str, Any]], index: int) -> dict[str, Any]:
    # A negative number would count from the end.
    if index < 0:
        raise IndexError(index)
    return entries[index]


def _matrix(node: dict[str, Any]) -> Array:
    """Transform (4, 4) of a node: its matrix, column by column, or its scale, turn and shift."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = (float(value) for value in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=float)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
