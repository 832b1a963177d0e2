"""GLB (glTF 2.0, binary): the marker at true meters with its materials, for viewers and simulators.

The meshes are in the marker frame. Their root node turns it into glTF's, whose y is up: x stays, the marker's z (out of
its face) becomes up, and its y becomes -z, so that it lies on the ground face up. Programs with z up turn it back when
they load it (Blender, Drake, RViz), and so have the marker frame again.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

import markergen
from markergen.exporters import ExportOptions, Output
from markergen.exporters.meshes import MATERIALS, MeshedPart, meshed
from markergen.model.marker import Marker
from markergen.solid.bodies import COLORS, OTHER

TURN = (1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1)
"""The root node's matrix, column by column: (x, y, z) becomes (x, z, -y)."""

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
FLOAT, UNSIGNED_INT = 5126, 5125


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """All parts as GLB in meters, y up."""
    made = meshed(markers, options, ".glb")
    return Output(write_glb(made.parts, made.name), made.notes)


def write_glb(parts: Sequence[MeshedPart], name: str) -> bytes:
    """Write parts as the children of one node called `name`, each with its own mesh; m."""
    binary = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []

    def add(values: Any, target: int, **accessor: Any) -> int:
        """Number of a new accessor of an array; all types are four bytes wide, so that all are aligned."""
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes, "target": target})
        binary.extend(values.tobytes())
        accessors.append({"bufferView": len(views) - 1, **accessor})
        return len(accessors) - 1

    meshes = []
    for part in parts:
        points = (part.mesh.points / 1e3).astype("<f4")
        position = add(
            points, ARRAY_BUFFER, componentType=FLOAT, count=len(points), type="VEC3",
            # Written as the floats they are: some readers hold the array against them.
            min=points.min(axis=0).astype(float).tolist(), max=points.max(axis=0).astype(float).tolist(),
        )  # fmt: skip
        primitives = []
        for material, chosen in ((part.material, ~part.mesh.marked), (OTHER[part.material], part.mesh.marked)):
            indices = part.mesh.triangles[chosen].astype("<u4").ravel()
            if len(indices):
                corners = add(
                    indices, ELEMENT_ARRAY_BUFFER, componentType=UNSIGNED_INT, count=len(indices), type="SCALAR"
                )
                primitives.append(
                    {
                        "attributes": {"POSITION": position},
                        "indices": corners,
                        "material": MATERIALS.index(material),
                    }
                )
        meshes.append({"name": part.name, "primitives": primitives})
    document = {
        "asset": {"version": "2.0", "generator": f"markergen {markergen.__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": name, "matrix": TURN, "children": list(range(1, len(parts) + 1))},
            *({"name": part.name, "mesh": number} for number, part in enumerate(parts)),
        ],
        "meshes": meshes,
        "materials": [_material(material) for material in MATERIALS],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    return _container(text, bytes(binary))


def _material(name: str) -> dict[str, Any]:
    # glTF takes colors before gamma, and a material is metal unless it says otherwise.
    color = [*(round(_linear(channel), 6) for channel in COLORS[name]), 1.0]
    return {
        "name": name,
        "pbrMetallicRoughness": {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 0.9},
    }


def _linear(channel: float) -> float:
    """A channel of sRGB in linear light (IEC 61966-2-1)."""
    return channel / 12.92 if channel <= 0.04045 else float(((channel + 0.055) / 1.055) ** 2.4)


def _container(text: bytes, binary: bytes) -> bytes:
    """Header, and two chunks whose lengths are multiples of four."""
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        np.array([len(chunk)], "<u4").tobytes() + kind + chunk for kind, chunk in ((b"JSON", text), (b"BIN\0", binary))
    )
    return b"glTF" + np.array([2, 12 + len(chunks)], "<u4").tobytes() + chunks
