"""Meshes: the parts of a marker as STL, 3MF and GLB, with the same bytes every time.

GLB (glTF 2.0, binary) is in meters, the others in mm. All meshes are in the marker frame. The root node of a GLB
rotates them to glTF's frame with y up: x is unchanged, the marker's z (out of its face) becomes up, and its y becomes
-z, so that it lies on the ground face up. Programs with z up (Blender, Drake, RViz) undo this rotation on loading, and
thus restore the marker frame.
"""

import json
import zipfile
from collections.abc import Mapping, Sequence
from io import BytesIO
from types import MappingProxyType
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

import markergen
from markergen.exporters import ExportOptions, Output
from markergen.model.marker import Marker
from markergen.model.rig import Rig
from markergen.solid.primitives import COLORS, OTHER
from markergen.workshop.formats.solids import EXPORTED
from markergen.workshop.mesh import MATERIALS, Mesh, kept_apart, meshed, stl_of

MODEL = "3D/3dmodel.model"
VOLUMES = "Metadata/Slic3r_PE_model.config"
"""Where PrusaSlicer expects the parts of a mesh, as ranges of triangles with their extruders."""
TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    '<Default Extension="config" ContentType="text/xml"/>'
    "</Types>\n"
)
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Id="model" Target="/{MODEL}" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Earliest time that a zip file can store, used in every file."""

TURN = (1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1)
"""Column-major matrix of the root node: (x, y, z) becomes (x, z, -y)."""

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
"""Use of a buffer view in glTF: corners, and their indices."""
FLOAT, UNSIGNED_INT = 5126, 5125
"""Types of numbers in glTF, those of OpenGL."""


def export_stl(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """All parts as one STL in mm; if there are two materials, also ``<stem>-light.stl`` and ``<stem>-dark.stl``."""
    work, parts = meshed(bodies, options, ".stl")
    materials = [material for material in MATERIALS if any(part.material == material for part in parts)]
    beside = {}
    notes = [f"STL has no unit: it is in millimeters, in the {work.subject.frame} frame.", *work.notes]
    if len(materials) > 1:
        for material in materials:
            alone = [part for part in parts if part.material == material]
            beside[f"{options.stem}-{material}.stl"] = write_stl(alone, work.name, work.short_record)
        notes.append(f"Beside it, one file for each material to print together: {', '.join(beside)}.")
    if any(part.marked.any() for part in parts):
        notes.append("STL has no colors: what is engraved is as light as the plate in it.")
    return Output(write_stl(parts, work.name, work.short_record), tuple(notes), beside)


def write_stl(parts: Sequence[Mesh], name: str, record: str = "") -> bytes:
    """Write parts as one binary STL named `name`, each a closed surface, in mm, marker frame."""
    meshes = kept_apart(parts)
    return stl_of(np.concatenate([mesh.points[mesh.triangles] for mesh in meshes]), name, "mm", record)


def export_3mf(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """All parts as 3MF in mm: as one mesh; if there are two materials, also as several in ``<stem>-parts.3mf``.

    PrusaSlicer takes every mesh of a package as an object of its own, whatever component object it belongs to, and
    drops it onto the bed; it finds the parts of one mesh by `VOLUMES`. Cura gives a mesh one material, whatever its
    triangles have, and OrcaSlicer and Bambu Studio take components as parts. One file cannot serve both.
    """
    work, parts = meshed(bodies, options, ".3mf")
    whole = write_3mf(parts, work.name, work.record)
    if len({part.material for part in parts}) == 1:
        return Output(whole, work.notes)
    beside = f"{options.stem}-parts.3mf"
    use = (
        "The file is for PrusaSlicer, which prints light parts with extruder 1 and dark ones with extruder 2. "
        f"Open {beside} beside it in Cura, OrcaSlicer and Bambu Studio."
    )
    return Output(whole, (use, *work.notes), {beside: write_3mf_of_parts(parts, work.name, work.record)})


def write_3mf(parts: Sequence[Mesh], name: str, record: str = "") -> bytes:
    """Write parts as a 3MF package with one object `name` of one mesh; mm, marker frame; lies on the bed.

    Each triangle has its material. The parts follow one another and share no points, and PrusaSlicer reads their names
    and extruders from `VOLUMES`.
    """
    meshes, main = kept_apart(parts), parts[0].material
    vertices, triangles, volumes, points, first = [], [], [], 0, 0
    for mesh in meshes:
        vertices.append(_vertices(mesh))
        triangles.append(_triangles(mesh, points, main))
        last = first + len(mesh.triangles) - 1
        volumes.append(
            f'<volume firstid="{first}" lastid="{last}">'
            f'<metadata type="volume" key="name" value={quoteattr(mesh.name)}/>'
            f'<metadata type="volume" key="extruder" value="{MATERIALS.index(mesh.material) + 1}"/></volume>\n'
        )
        points, first = points + len(mesh.points), last + 1
    whole = _3mf_object(2, name, main, "".join(vertices), "".join(triangles))
    ranges = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<config>\n<object id="2">\n{"".join(volumes)}</object>\n</config>\n'
    )
    item = f'<item objectid="2" transform="{_lift(meshes)}"/>'
    # Without a version PrusaSlicer moves only the first of the parts by the item's transform.
    version = '<metadata name="slic3rpe:Version3mf">1</metadata>\n'
    return _3mf_package(name, _3mf_model(name, whole, item, version), record, {VOLUMES: ranges})


def write_3mf_of_parts(parts: Sequence[Mesh], name: str, record: str = "") -> bytes:
    """Write parts as a 3MF package whose only build item is an object `name` made of them; mm, marker frame.

    Cura reads the numbers of their extruders, from 0, in metadata of its own.
    """
    # The object of all parts comes last: references in 3MF only point backward.
    whole = len(parts) + 2
    objects = []
    for number, part in enumerate(parts, start=2):
        # Cura counts extruders from 0, PrusaSlicer from 1.
        extruder = f'<metadata name="cura:extruder_nr">{MATERIALS.index(part.material)}</metadata>'
        objects.append(
            _3mf_object(
                number,
                part.name,
                part.material,
                _vertices(part),
                _triangles(part, 0, part.material),
                f"<metadatagroup>{extruder}</metadatagroup>",
            )
        )
    components = "".join(f'<component objectid="{number}"/>' for number in range(2, whole))
    objects.append(
        f'<object id="{whole}" type="model" name={quoteattr(name)}><components>{components}</components></object>\n'
    )
    return _3mf_package(name, _3mf_model(name, "".join(objects), f'<item objectid="{whole}"/>'), record)


def _3mf_package(name: str, model: str, record: str, others: Mapping[str, str] = MappingProxyType({})) -> bytes:
    package = BytesIO()
    with zipfile.ZipFile(package, "w") as archive:
        archive.comment = f"{name} {EXPORTED} {record}".encode("ascii") if record else name.encode("ascii")
        for path, text in {"[Content_Types].xml": TYPES, "_rels/.rels": RELATIONS, MODEL: model, **others}.items():
            entry = zipfile.ZipInfo(path, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            # Half the time of the default level for 2 % more bytes.
            archive.writestr(entry, text, compresslevel=5)
    return package.getvalue()


def _lift(meshes: Sequence[Mesh]) -> str:
    """Transform that lifts an object to the bed, and so much higher that Cura does not sink it.

    Where the lowest point plus the middle of the mesh is negative, Cura keeps the object that far below the bed; what
    hovers, slicers put down.
    """
    heights = np.concatenate([mesh.points[:, 2] for mesh in meshes])
    low, middle = heights.min(), (heights.min() + heights.max()) / 2
    return f"1 0 0 0 1 0 0 0 1 0 0 {max(0.0, -low, -low - middle):.9g}"


def _3mf_model(name: str, objects: str, item: str, metadata: str = "") -> str:
    materials = "".join(f'<base name="{material}" displaycolor="{_hex(COLORS[material])}"/>' for material in MATERIALS)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
        'xmlns:cura="http://software.ultimaker.com/xml/cura/3mf/2015/10" '
        'xmlns:slic3rpe="http://schemas.slic3r.org/3mf/2017/06">\n'
        f'<metadata name="Title">{name}</metadata>\n'
        f'<metadata name="Application">markergen {markergen.__version__}</metadata>\n'
        f'{metadata}<resources>\n<basematerials id="1">{materials}</basematerials>\n'
        f"{objects}</resources>\n<build>{item}</build>\n</model>\n"
    )


def _3mf_object(number: int, name: str, material: str, vertices: str, triangles: str, metadata: str = "") -> str:
    return (
        f'<object id="{number}" type="model" name={quoteattr(name)} pid="1" pindex="{MATERIALS.index(material)}">'
        f"{metadata}<mesh>\n<vertices>\n{vertices}</vertices>\n<triangles>\n{triangles}</triangles>\n</mesh></object>\n"
    )


def _vertices(mesh: Mesh) -> str:
    # Nine digits represent a 32-bit float exactly.
    return '<vertex x="%.9g" y="%.9g" z="%.9g"/>\n' * len(mesh.points) % tuple(mesh.points.ravel().tolist())


def _triangles(mesh: Mesh, first: int, main: str) -> str:
    """Triangles of a part, its points counted from `first`, in an object of the material `main`."""
    seen = {False: mesh.material, True: OTHER[mesh.material]}
    paints = {
        marked: "" if seen[marked] == main else f' pid="1" p1="{MATERIALS.index(seen[marked])}"' for marked in seen
    }
    forms = [f'<triangle v1="%s" v2="%s" v3="%s"{paints[marked]}/>\n' for marked in mesh.marked.tolist()]
    names = np.arange(first, first + len(mesh.points)).astype(str)
    return "".join(forms) % tuple(names[mesh.triangles].ravel().tolist())


def _hex(color: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(channel * 255):02X}" for channel in color) + "FF"


def export_glb(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """All parts as GLB in meters, y up."""
    work, parts = meshed(bodies, options, ".glb")
    return Output(write_glb(parts, work.name, work.record), work.notes)


def write_glb(parts: Sequence[Mesh], name: str, record: str = "") -> bytes:
    """Write parts as the children of a node named `name`, each with its own mesh; m."""
    binary = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []

    def add(values: Any, target: int, **accessor: Any) -> int:
        """Index of a new accessor for an array; all types are four bytes wide, so that all are aligned."""
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes, "target": target})
        binary.extend(values.tobytes())
        accessors.append({"bufferView": len(views) - 1, **accessor})
        return len(accessors) - 1

    meshes = []
    for part in parts:
        points = (part.points / 1e3).astype("<f4")
        position = add(
            points, ARRAY_BUFFER, componentType=FLOAT, count=len(points), type="VEC3",
            # Exactly as stored in float32: some readers compare them with the array.
            min=points.min(axis=0).astype(float).tolist(), max=points.max(axis=0).astype(float).tolist(),
        )  # fmt: skip
        primitives = []
        for material, chosen in ((part.material, ~part.marked), (OTHER[part.material], part.marked)):
            indices = part.triangles[chosen].astype("<u4").ravel()
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
        "asset": {
            "version": "2.0",
            "generator": f"markergen {markergen.__version__}",
            **({"extras": {EXPORTED: json.loads(record)}} if record else {}),
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": name, "matrix": TURN, "children": list(range(1, len(parts) + 1))},
            *({"name": part.name, "mesh": number} for number, part in enumerate(parts)),
        ],
        "meshes": meshes,
        "materials": [_gltf_material(material) for material in MATERIALS],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    return _glb_container(text, bytes(binary))


def _gltf_material(name: str) -> dict[str, Any]:
    # glTF colors are linear, and materials are metallic by default.
    color = [*(round(_linear(channel), 6) for channel in COLORS[name]), 1.0]
    return {
        "name": name,
        "pbrMetallicRoughness": {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 0.9},
    }


def _linear(channel: float) -> float:
    """Convert an sRGB channel to linear light (IEC 61966-2-1)."""
    return channel / 12.92 if channel <= 0.04045 else float(((channel + 0.055) / 1.055) ** 2.4)


def _glb_container(text: bytes, binary: bytes) -> bytes:
    """Header, and two chunks with lengths padded to multiples of four."""
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        np.array([len(chunk)], "<u4").tobytes() + kind + chunk for kind, chunk in ((b"JSON", text), (b"BIN\0", binary))
    )
    return b"glTF" + np.array([2, 12 + len(chunks)], "<u4").tobytes() + chunks
