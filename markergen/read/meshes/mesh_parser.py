"""Parsers of mesh files; `markergen.guard` runs this script in a child process for `verification.solid_files`."""

# tests: tests/verification/test_solid_readers.py

import json
import posixpath
import struct
import warnings
import zipfile
import zlib
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError, brief, reason_of
from markergen.guard import MOST_TRIANGLES
from markergen.read.meshes import LONGEST, MOST_OBJECTS, Color, MeshObject

Attributes = dict[str, str]

Reply = tuple[dict[str, Any], dict[str, NDArray[Any]]]
"""Names and colors of a file's objects, and arrays keyed ``corners`` or ``paints`` plus the object's number."""

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_WORDS = {b"solid", b"endsolid", b"facet", b"outer", b"vertex", b"endloop", b"endfacet"}
"""A triangle of a binary STL, and the first words of the lines of a text."""


def _reply(meshes: list[MeshObject], flaws: Iterable[str] = ()) -> Reply:
    arrays: dict[str, NDArray[Any]] = {f"corners{k}": mesh.corners for k, mesh in enumerate(meshes)}
    arrays |= {f"paints{k}": mesh.paints for k, mesh in enumerate(meshes) if mesh.paints is not None}
    objects = [{"name": mesh.name, "color": mesh.color, "palette": mesh.palette, "tool": mesh.tool} for mesh in meshes]
    return {"objects": objects, "flaws": list(dict.fromkeys(flaws))}, arrays


def read_stl(data: bytes) -> Reply:
    """Read the triangles of a binary or text STL; its normals are ignored, and it has no unit, color or parts."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) >= 84 and len(data) == 84 + 50 * count:
        corners = np.frombuffer(data, FACET, offset=84)["corners"].astype(float)
    else:
        corners = _text_corners(data, count)
    return _reply([MeshObject(corners)] if len(corners) else [])


def _text_corners(data: bytes, count: int) -> Array:
    """Corners (m, 3, 3) of a text STL, of which every line is known."""
    if data.lstrip()[:5].lower() != b"solid":
        problem = f"{len(data)} bytes where the header implies {84 + 50 * count}"
        raise InputError("a complete STL", problem, "export it again")
    lines = [line.split(None, 1) for line in data.splitlines() if line.strip()]
    firsts = [line[0].lower() for line in lines]
    if not set(firsts) <= STL_WORDS:
        raise InputError("an STL", "lines of another kind", "export it again")
    facets = firsts.count(b"endfacet")
    if facets > MOST_TRIANGLES:
        raise InputError(f"at most {MOST_TRIANGLES} triangles", str(facets), "use a larger --tolerance")
    if firsts[-1] != b"endsolid" or firsts.count(b"vertex") != 3 * facets:
        raise InputError("a complete STL", "triangles without three corners, or no end", "export it again")
    places = b" ".join(line[-1] for line, first in zip(lines, firsts, strict=True) if first == b"vertex")
    with warnings.catch_warnings():
        # numpy only warns where it stops reading.
        warnings.simplefilter("error")
        try:
            return np.fromstring(places, sep=" ").reshape(facets, 3, 3)
        except (ValueError, DeprecationWarning):
            raise InputError("three numbers for each corner", "something else", "export it again") from None


# --- GLB --------------------------------------------------------------------------------------------------------------

MOST_NODES, DEEPEST_NODE = 20_000, 50
"""Maximum number of nodes of a scene that wait to be read, and their maximum depth; a file of ours has two levels."""

LARGEST_JSON = 10_000_000
"""Maximum size in bytes of the text in a GLB: 15,000 parts."""

INTEGERS = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
FLOAT, TRIANGLES = 5126, 4
"""Types of numbers and of primitives in a glTF."""

GLB_KEYS = {
    "glTF": {
        "asset", "scene", "scenes", "nodes", "meshes", "materials", "accessors", "bufferViews", "buffers", "cameras",
        "extensionsUsed", "images", "samplers",
    },
    "scene": {"nodes"},
    "node": {"mesh", "children", "matrix", "translation", "rotation", "scale", "camera"},
    "mesh": {"primitives"},
    "primitive": {"attributes", "indices", "material", "mode"},
    "attribute": {"POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "TEXCOORD_1"},
    "material": {"pbrMetallicRoughness", "doubleSided", "alphaMode", "alphaCutoff", "emissiveFactor"},
    "color": {"baseColorFactor", "metallicFactor", "roughnessFactor"},
}  # fmt: skip
"""Keys of each kind of entry of a glTF that are read, or that change no shape and no color."""

HARMLESS_KEYS = {"name", "extras", "extensions"}
HARMLESS_EXTENSIONS = {
    "KHR_lights_punctual", "KHR_materials_ior", "KHR_materials_specular", "KHR_materials_unlit", "KHR_xmp_json_ld",
}  # fmt: skip
"""Keys and extensions of any entry that do not either."""

FRAME = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Rotation from glTF's axes (y up, z toward the viewer) to those of simulators and of the marker (z up)."""


def read_glb(data: bytes) -> Reply:
    """Read the meshes of a GLB's scene, in mm, marker frame; the primitives of a mesh differ in material."""
    document, binary = _parts_of_glb(data)
    try:
        nodes = list(_glb_nodes(document))
        counts = [_glb_count(document, primitive) for node, _ in nodes for primitive in _glb_primitives(document, node)]
        if sum(counts) > MOST_TRIANGLES:
            raise InputError(
                f"at most {MOST_TRIANGLES} triangles", str(sum(counts)), "export it with a larger tolerance"
            )
        if len(counts) > MOST_OBJECTS:
            raise InputError(f"at most {MOST_OBJECTS} meshes", str(len(counts)), "export the marker alone")
        meshes = [_glb_mesh(document, binary, node, matrix) for node, matrix in nodes if "mesh" in node]
        flaws = list(_glb_flaws(document))
    # What Python raises for entries of a document that are missing or of another kind.
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError("a complete GLB", "inconsistent parts", "export it again") from None
    return _reply([mesh for mesh in meshes if len(mesh.corners)], flaws)


def _glb_flaws(document: dict[str, Any]) -> Iterator[str]:
    """What programs draw otherwise than triangles in one opaque color: all that is not read, and is not harmless."""
    primitives = [primitive for mesh in document.get("meshes", []) for primitive in mesh["primitives"]]
    materials = document.get("materials", [])
    colors = [material.get("pbrMetallicRoughness", {}) for material in materials]
    for kind, entries in (
        ("glTF", [document]), ("scene", document["scenes"]), ("node", document["nodes"]),
        ("mesh", document.get("meshes", [])), ("primitive", primitives), ("material", materials), ("color", colors),
        ("attribute", [primitive["attributes"] for primitive in primitives]),
    ):  # fmt: skip
        extensions = (extension for entry in entries for extension in entry.get("extensions", ()))
        keys = {key for entry in entries for key in entry} - GLB_KEYS[kind] - HARMLESS_KEYS
        for key in sorted({*keys, *extensions} - HARMLESS_EXTENSIONS):
            yield f"a {kind} has {brief(key)}, which is not read"
    if any(
        "matrix" in node and not {"translation", "rotation", "scale"}.isdisjoint(node) for node in document["nodes"]
    ):
        yield "a node has a matrix beside its translation, rotation or scale"
    if any(primitive.get("mode", TRIANGLES) != TRIANGLES for primitive in primitives):
        yield "it has lines or points, which are not read"
    for material, color in zip(materials, colors, strict=True):
        name = brief(str(material.get("name", "")))
        mode, opacity = material.get("alphaMode", "OPAQUE"), float(color.get("baseColorFactor", (1, 1, 1, 1))[3])
        if mode != "OPAQUE" and (mode == "MASK" or opacity < 1):
            yield f"the material {name} is transparent"
        if any(material.get("emissiveFactor", ())):
            yield f"the material {name} glows"
        # Metal has the color of what it mirrors. It is the default of glTF, but programs that leave it out mean none.
        if color.get("metallicFactor", 0.0) > 0.5 and "KHR_materials_unlit" not in material.get("extensions", ()):
            yield f"the material {name} is a metal"


def _parts_of_glb(data: bytes) -> tuple[dict[str, Any], memoryview]:
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
        if any("uri" in buffer for buffer in document.get("buffers", [])):
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
        if depth > DEEPEST_NODE or len(todo) > MOST_NODES:
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
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), dtype=float)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=float)
    return matrix


def _glb_primitives(document: dict[str, Any], node: dict[str, Any]) -> list[dict[str, Any]]:
    primitives = _at(document["meshes"], node["mesh"])["primitives"] if "mesh" in node else []
    return [primitive for primitive in primitives if primitive.get("mode", TRIANGLES) == TRIANGLES]


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
    palette: list[Color] = []
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
    if not palette:
        return MeshObject(every, name)
    return MeshObject(every, name, palette[main], np.where(paint == main, -1, paint), palette)


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


def _glb_color(document: dict[str, Any], primitive: dict[str, Any]) -> Color:
    """Color of a primitive; white without a material, as the format has it."""
    material = _at(document["materials"], primitive["material"]) if "material" in primitive else {}
    factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", (1, 1, 1, 1))
    red, green, blue = (float(value) for value in factor[:3])
    return red, green, blue


# --- 3MF --------------------------------------------------------------------------------------------------------------

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
ROOT = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
VOLUMES = "metadata/slic3r_pe_model.config"
"""Where PrusaSlicer finds the parts of a mesh: ranges of triangles, with names and extruders."""

COLORS = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
SETS = "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07"
"""Namespaces of colors, which are read, and of names for triangles."""

THREEMF_KEYS = {
    f"{CORE} {tag}": set(keys.split())
    for tag, keys in {
        "model": "unit requiredextensions recommendedextensions", "metadata": "name preserve type", "metadatagroup": "",
        "resources": "", "basematerials": "id", "base": "name displaycolor",
        "object": "id type name pid pindex partnumber thumbnail", "mesh": "", "vertices": "", "vertex": "x y z",
        "triangles": "", "triangle": "v1 v2 v3 pid p1 p2 p3", "components": "", "component": "objectid transform",
        "build": "", "item": "objectid transform partnumber printable",
    }.items()
} | {f"{COLORS} colorgroup": {"id"}, f"{COLORS} color": {"color"}}  # fmt: skip
"""Elements and attributes of a 3MF that are read, or that change no shape and no color."""

HARMLESS_ATTRIBUTES = {"UUID", "lang", "printable", "schemaLocation"}
"""Attributes of other namespaces, of which some do not either."""

UNITS = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
"""Units of a model, in mm."""

LARGEST = 200_000_000
"""Maximum size of the unpacked model, in bytes."""

PIECE = 1 << 18
"""Number of bytes that are unpacked and parsed at a time, and the maximum size of an XML tag."""

MOST_ENTRIES = 1_000
"""Maximum number of files in a 3MF, which has some ten."""

DEEPEST_COMPONENT = 10
"""Maximum depth of components in components."""


@dataclass
class _Object:
    """An object being read: a mesh, or components (object, transform). Arrays are flat."""

    name: str
    paint: int
    group: str
    vertices: "array[float]" = field(default_factory=lambda: array("d"))
    triangles: "array[int]" = field(default_factory=lambda: array("i"))
    paints: "array[int]" = field(default_factory=lambda: array("i"))
    components: list[tuple[str, Array]] = field(default_factory=list)


class _Volume(NamedTuple):
    """A range of triangles that PrusaSlicer takes as a part of its own."""

    first: int
    last: int
    name: str
    tool: str


def read_3mf(data: bytes) -> Reply:
    """Read the objects in the build of a 3MF, in mm."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as package:
            infos = package.infolist()
            if len(infos) > MOST_ENTRIES:
                raise InputError(f"at most {MOST_ENTRIES} files in a 3MF", str(len(infos)), "export it again")
            names = {info.filename.lower(): info for info in infos}
            path = "3d/3dmodel.model"
            for tag, attributes in _elements(package, names.get("_rels/.rels")):
                if tag.endswith(" Relationship") and attributes and attributes.get("Type") == ROOT:
                    path = posixpath.normpath(attributes.get("Target", path)).lstrip("/")
            info = names.get(path.lower())
            if info is None:
                raise InputError("a 3MF", "a package without a model", "export it again")
            if info.file_size > LARGEST:
                raise InputError(f"a model of at most {LARGEST // 10**6} MB", "a larger one", "export the marker alone")
            model = _Model()
            for tag, attributes in _elements(package, info):
                model.take(tag, attributes)
            volumes, flaws = _volumes(_elements(package, names.get(VOLUMES)))
    # zipfile, zlib and struct raise these for broken packages; RuntimeError is for encrypted ones.
    except (zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, RuntimeError) as error:
        raise InputError("a 3MF", f"a broken package: {reason_of(error)}", "export it again") from None
    # Names and numbers that are missing or invalid.
    except (ValueError, KeyError, OverflowError):
        raise InputError("the numbers of a 3MF", "missing or invalid ones", "export it again") from None
    return _reply(model.built(volumes), [*model.flaws, *flaws])


def _pieces(package: zipfile.ZipFile, info: zipfile.ZipInfo) -> Iterator[bytes]:
    """Unpack an entry piece by piece; raises InputError beyond `LARGEST`, whatever size it declares."""
    left = LARGEST
    with package.open(info) as stream:
        while piece := stream.read(PIECE):
            left -= len(piece)
            if left < 0:
                raise InputError(f"a model of at most {LARGEST // 10**6} MB", "a larger one", "export the marker alone")
            yield piece


def _elements(package: zipfile.ZipFile, info: zipfile.ZipInfo | None) -> Iterator[tuple[str, Attributes | None]]:
    """Yield the elements of an entry, ``namespace name`` with attributes, and their ends, which have none.

    Document types and thus entities, and endless tags, are refused.
    """
    parser = expat.ParserCreate(namespace_separator=" ")
    events: list[tuple[str, Attributes | None]] = []

    def refuse(*_: object) -> NoReturn:
        raise InputError("plain XML", "a document type", "export it again")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda tag, attributes: events.append((tag, attributes))
    parser.EndElementHandler = lambda tag: events.append((tag, None))
    fed = 0
    try:
        for piece in _pieces(package, info) if info else ():
            parser.Parse(piece, False)
            fed += len(piece)
            if fed - parser.CurrentByteIndex > 2 * PIECE:
                raise InputError("plain XML", "a tag or text without an end", "export it again")
            yield from events
            events.clear()
        if info:
            parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise InputError("complete XML", reason_of(error), "export it again") from None
    yield from events


def _volumes(elements: Iterable[tuple[str, Attributes | None]]) -> tuple[dict[str, list[_Volume]], list[str]]:
    """PrusaSlicer's parts by the number of their object, and which of them are not printed."""
    volumes: dict[str, list[_Volume]] = {}
    flaws: list[str] = []
    ranges: list[_Volume] = []
    for tag, attributes in elements:
        if attributes is None:
            continue
        if tag == "object":
            ranges = volumes.setdefault(attributes["id"], [])
        elif tag == "volume":
            if sum(map(len, volumes.values())) >= MOST_OBJECTS:
                raise InputError(f"at most {MOST_OBJECTS} parts", "more", "export it again")
            ranges.append(_Volume(int(attributes["firstid"]), int(attributes["lastid"]), "", ""))
        elif tag == "metadata" and attributes.get("key", "").endswith("compensation") and attributes["value"] != "0":
            flaws.append(f"a part has {brief(attributes['key'])}, with which its outline is printed elsewhere")
        elif tag == "metadata" and ranges and attributes.get("type") == "volume":
            key, value = attributes.get("key"), attributes["value"][:LONGEST]
            if key == "name":
                ranges[-1] = ranges[-1]._replace(name=value)
            elif key == "extruder":
                ranges[-1] = ranges[-1]._replace(tool=value)
            elif key in ("volume_type", "modifier") and value not in ("ModelPart", "0"):
                flaws.append(f"the part {brief(ranges[-1].name)} is a {brief(value)}, not printed")
    return volumes, flaws


class _Model:
    """Model of a 3MF, collected while its XML is parsed."""

    def __init__(self) -> None:
        self.unit = 1.0
        self.flaws: list[str] = []
        self.palette: list[Color] = []
        self.first: dict[str, int] = {}
        self.objects: dict[str, _Object] = {}
        self.items: list[tuple[str, Array]] = []
        self._current: _Object | None = None
        self._counts = Counter[str]()
        self._starts = {
            f"{CORE} {word}": getattr(self, f"_{word}")
            for word in ("vertex", "triangle", "model", "basematerials", "base", "object", "component", "item")
        } | {f"{COLORS} colorgroup": self._basematerials, f"{COLORS} color": self._base}

    def take(self, tag: str, attributes: Attributes | None) -> None:
        """Collect objects, materials and build items; without attributes, leave an element."""
        if attributes is not None and not (tag in THREEMF_KEYS and attributes.keys() <= THREEMF_KEYS[tag]):
            self._unread(tag, attributes)
        if attributes is not None and (handler := self._starts.get(tag)) is not None:
            handler(attributes)
        elif attributes is None and tag == f"{CORE} object":
            self._current = None

    def _unread(self, tag: str, attributes: Attributes) -> None:
        """Note elements and attributes that programs read."""
        namespace, _, word = tag.rpartition(" ")
        if tag not in THREEMF_KEYS and namespace != SETS:
            self.flaws.append(f"it has a {brief(word)}, which is not read")
        elif tag in THREEMF_KEYS:
            others = (key.rpartition(" ") for key in attributes.keys() - THREEMF_KEYS[tag])
            names = sorted(key for space, _, key in others if not (space and key in HARMLESS_ATTRIBUTES))
            self.flaws += [f"a {word} has {brief(key)}, which is not read" for key in names]

    def _vertex(self, attributes: Attributes) -> None:
        if self._current:
            self._current.vertices.extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
            self._counted("corners", MOST_TRIANGLES)  # Of a closed mesh half as many.

    def _triangle(self, attributes: Attributes) -> None:
        current = self._current
        if not current:
            return
        current.triangles.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"])))
        current.paints.append(
            self._paint(attributes.get("pid", current.group), attributes["p1"]) if "p1" in attributes else current.paint
        )
        if any(attributes.get(key, attributes.get("p1")) != attributes.get("p1") for key in ("p2", "p3")):
            self.flaws.append("a triangle is painted in several colors")
        self._counted("triangles", MOST_TRIANGLES)

    def _model(self, attributes: Attributes) -> None:
        unit = attributes.get("unit", "millimeter")
        if unit not in UNITS:
            raise InputError("a unit of length", brief(unit), f"use one of {', '.join(UNITS)}")
        self.unit = UNITS[unit]

    def _basematerials(self, attributes: Attributes) -> None:
        self.first[attributes["id"]] = len(self.palette)

    def _base(self, attributes: Attributes) -> None:
        color = attributes["color"] if "color" in attributes else attributes["displaycolor"]
        self.palette.append(_color(color))
        if len(color) == 9 and color[7:].lower() != "ff":
            self.flaws.append(f"the material {brief(attributes.get('name', ''))} is transparent")
        self._counted("materials")

    def _object(self, attributes: Attributes) -> None:
        if (kind := attributes.get("type", "model")) not in ("model", "solidsupport"):
            self.flaws.append(f"an object is of the type {brief(kind)}, which is not printed as a model")
        group = attributes.get("pid", "")
        paint = self._paint(group, attributes.get("pindex", "0")) if group else -1
        self._current = self.objects[attributes["id"]] = _Object(attributes.get("name", "")[:LONGEST], paint, group)
        self._counted("objects")

    def _paint(self, group: str, number: str) -> int:
        """Index of a material in the palette; -1 for none."""
        index = self.first.get(group, -1 - MOST_OBJECTS) + int(number)
        return index if 0 <= index < len(self.palette) else -1

    def _counted(self, what: str, most: int = MOST_OBJECTS) -> None:
        self._counts[what] += 1
        if self._counts[what] > most:
            raise InputError(f"at most {most} {what}", "more", "export it with a larger tolerance, or the marker alone")

    def _component(self, attributes: Attributes) -> None:
        if self._current:
            self._current.components.append((attributes["objectid"], _matrix_of(attributes.get("transform"))))
            self._counted("components")

    def _item(self, attributes: Attributes) -> None:
        if any(key.split(" ")[-1] == "printable" and value in ("0", "false") for key, value in attributes.items()):
            self.flaws.append("an item is not to be printed")
        self.items.append((attributes["objectid"], _matrix_of(attributes.get("transform"))))
        self._counted("items to build")

    def built(self, volumes: dict[str, list[_Volume]]) -> list[MeshObject]:
        """Triangles in mm of all build items; of a single one without its shift, which is its place on the bed."""
        placed: list[tuple[str, Array]] = []
        if len(self.items) == 1:
            self.items[0][1][3, :3] = 0
        for key, transform in self.items:
            self._place(placed, key, transform, 0)
        total = sum(len(self.objects[key].triangles) for key, _ in placed) // 3
        if total > MOST_TRIANGLES:
            raise InputError(f"at most {MOST_TRIANGLES} triangles", str(total), "use a larger --tolerance")
        return [part for key, transform in placed for part in self._meshes(key, transform, volumes.get(key, []))]

    def _place(self, placed: list[tuple[str, Array]], key: str, transform: Array, depth: int) -> None:
        """Find the meshes of an object and their transforms, for at most `MOST_OBJECTS` steps."""
        item = self.objects.get(key)
        self._counted("parts of objects")
        if item is None or depth > DEEPEST_COMPONENT:
            raise InputError("objects that exist", f"object {brief(key)}", "export it again")
        for part, move in item.components:
            # Points are rows, so the leftmost transform applies first.
            self._place(placed, part, move @ transform, depth + 1)
        if item.triangles:
            placed.append((key, transform))

    def _meshes(self, key: str, transform: Array, volumes: list[_Volume]) -> list[MeshObject]:
        item = self.objects[key]
        triangles = np.array(item.triangles).reshape(-1, 3)
        vertices = np.array(item.vertices).reshape(-1, 3)
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise InputError("triangles between corners", "a corner that is missing", "export it again")
        vertices = self.unit * (vertices @ transform[:3, :3] + transform[3, :3])
        corners = vertices[triangles if np.linalg.det(transform[:3, :3]) > 0 else triangles[:, ::-1]]
        paints = np.array(item.paints, dtype=np.int64)
        color = self.palette[item.paint] if item.paint >= 0 else None
        paints[paints == item.paint] = -1
        inside = [part for part in volumes if 0 <= part.first <= part.last < len(corners)]
        ranges = inside or [_Volume(0, len(corners) - 1, item.name, "")]
        return [
            MeshObject(corners[here], part.name, color, paints[here], self.palette, part.tool)
            for part in ranges
            for here in [slice(part.first, part.last + 1)]
        ]


def _matrix_of(text: str | None) -> Array:
    """Matrix (4, 4), for row vectors, from its twelve numbers."""
    matrix = np.eye(4)
    if text is not None:
        matrix[:, :3] = np.array([float(word) for word in text.split()]).reshape(4, 3)
    return matrix


def _color(text: str) -> Color:
    """Red, green and blue of ``#RRGGBB`` or ``#RRGGBBAA``."""
    if not (text.startswith("#") and len(text) in (7, 9)):
        raise ValueError(text)
    red, green, blue = (int(text[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
