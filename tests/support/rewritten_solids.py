"""Parts of solids as other programs read, change and write them; none of it is our writers' or readers' code."""

import json
import struct
import zipfile
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from io import BytesIO
from xml.sax.saxutils import quoteattr

import numpy as np
from spoiled_solids import stl

LIGHT, DARK = (1.0, 1.0, 1.0), (0.05, 0.05, 0.05)
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
TURN = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]


@contextmanager
def in_gmsh(path):
    """Gmsh with a solid's file, in mm."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        yield gmsh
    finally:
        gmsh.finalize()


@lru_cache(maxsize=2)
def meshes_of_3mf(data):
    """Meshes of lib3mf, from a file with which it has no quarrel."""
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(data)
    assert reader.GetWarningCount() == 0
    meshes, results = model.GetMeshObjects(), []
    while meshes.MoveNext():
        results.append(meshes.GetCurrentMeshObject())
        assert results[-1].IsValid()
        assert results[-1].IsManifoldAndOriented()
    return results


@dataclass(frozen=True, eq=False)
class Piece:
    """A part: its name, whether it is dark, and its triangles (m, 3, 3) in mm, marker frame."""

    name: str
    dark: bool
    corners: np.ndarray

    def mapped(self, matrix, offset=(0.0, 0.0, 0.0)):
        corners = self.corners @ np.asarray(matrix).T + offset
        return replace(self, corners=corners if np.linalg.det(matrix) > 0 else corners[:, ::-1])


def pieces(path):
    """Parts of a GLB, by trimesh."""
    import trimesh

    scene = trimesh.load_scene(path)
    result = []
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry].copy()
        mesh.apply_transform(matrix)
        x, y, z = np.moveaxis(1e3 * np.asarray(mesh.triangles), -1, 0)
        dark = mesh.visual.material.baseColorFactor[0] < 128
        result.append(Piece(node, bool(dark), np.stack([x, -z, y], axis=-1)))
    return result


def write(path, subset):
    """Write parts as .stl, .3mf or .glb."""
    made = {".stl": lambda parts: stl(np.concatenate([part.corners for part in parts])), ".3mf": _threemf, ".glb": _glb}
    path.write_bytes(made[path.suffix](subset))


def _threemf(subset):
    objects, components = [], []
    for number, part in enumerate(subset, start=2):
        points, index = np.unique(part.corners.reshape(-1, 3), axis=0, return_inverse=True)
        vertices = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in points.tolist())
        faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in index.reshape(-1, 3).tolist())
        objects.append(
            f'<object id="{number}" type="model" name={quoteattr(part.name)} pid="1" pindex="{int(part.dark)}"><mesh>'
            f"<vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh></object>"
        )
        components.append(f'<component objectid="{number}"/>')
    text = (
        f'<model unit="millimeter" xmlns="{CORE}"><resources><basematerials id="1">'
        '<base name="light" displaycolor="#FFFFFF"/><base name="dark" displaycolor="#0D0D0D"/></basematerials>'
        f'{"".join(objects)}<object id="1000000" type="model"><components>{"".join(components)}</components></object>'
        '</resources><build><item objectid="1000000"/></build></model>'
    )
    relations = "http://schemas.openxmlformats.org/package/2006/relationships"
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{relations}">'
            f'<Relationship Id="m" Target="/3D/a.model" Type="{MODEL}"/></Relationships>',
        )
        package.writestr("3D/a.model", text)
    return out.getvalue()


def _glb(subset):
    binary, views, accessors, meshes = b"", [], [], []
    for part in subset:
        points = (1e-3 * part.corners.reshape(-1, 3)).astype("<f4")
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": points.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": len(points), "type": "VEC3"})
        meshes.append({"primitives": [{"attributes": {"POSITION": len(views) - 1}, "material": int(part.dark)}]})
        binary += points.tobytes()
    nodes = [{"name": part.name, "mesh": k} for k, part in enumerate(subset)]
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [len(subset)]}],
        "nodes": [*nodes, {"matrix": TURN, "children": list(range(len(subset)))}], "meshes": meshes,
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0]}} for color in (LIGHT, DARK)],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
