"""STL (binary): the whole marker, and beside it one file per material."""

from collections.abc import Sequence

import numpy as np

import markergen
from markergen.exporters import ExportOptions, Output
from markergen.exporters.meshes import MATERIALS, MeshedPart, meshed
from markergen.model.marker import Marker
from markergen.solid.mesh import kept_apart

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """All parts as one STL in mm; where they are of two materials also ``<stem>-light.stl`` and ``<stem>-dark.stl``."""
    made = meshed(markers, options, ".stl")
    by_material = {
        material: [part for part in made.parts if part.material == material]
        for material in MATERIALS
        if any(part.material == material for part in made.parts)
    }
    beside = {}
    notes = ["STL has no unit: it is in millimeters, in the marker frame.", *made.notes]
    if len(by_material) > 1:
        beside = {
            f"{options.stem}-{material}.stl": write_stl(some, made.name) for material, some in by_material.items()
        }
        notes.append(f"Beside it, one file for each material to print together: {', '.join(beside)}.")
    if any(part.mesh.marked.any() for part in made.parts):
        notes.append("STL has no colors: what is engraved is as light as the plate in it.")
    return Output(write_stl(made.parts, made.name), tuple(notes), beside)


def write_stl(parts: Sequence[MeshedPart], name: str) -> bytes:
    """Write parts as one binary STL called `name`: a closed surface each, in mm, marker frame."""
    meshes = kept_apart([part.mesh for part in parts])
    corners = np.concatenate([mesh.points[mesh.triangles] for mesh in meshes])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    facets = np.zeros(len(corners), FACET)
    # The kernel leaves some triangles with corners in a line, which close the surface and have no normal.
    facets["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    facets["corners"] = corners
    # A text STL begins with "solid", so a binary one must not.
    header = f"{name}, markergen {markergen.__version__}, mm".encode("ascii").ljust(80)
    return header + np.uint32(len(facets)).astype("<u4").tobytes() + facets.tobytes()
