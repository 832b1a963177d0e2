"""Parsers of mesh files; `markergen.guard` runs this script in a child process for `mesh`.

trimesh parses STL and GLB. Because it accepts malformed files, its input is checked first: the keywords of a text STL;
the lengths, indices and required extensions of a GLB. 3MF is parsed here: trimesh drops the colors of base materials,
which distinguish a dot from the plate, and would need lxml.
"""

import importlib.util
import json
import posixpath
import sys
import types
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.guard import MOST_TRIANGLES

Array = NDArray[np.float64]
Color = tuple[float, float, float]
Attributes = dict[str, str]
Found = tuple[dict[str, Any], dict[str, NDArray[Any]]]
"""Names and colors of a file's objects, and arrays keyed ``corners`` or ``paints`` plus the object's number."""

STL_WORDS = {b"solid", b"endsolid", b"facet", b"outer", b"vertex", b"endloop", b"endfacet"}

INDICES = {
    "accessor",
    "buffer",
    "bufferView",
    "byteOffset",
    "byteLength",
    "byteStride",
    "count",
    "indices",
    "material",
    "mesh",
    "scene",
    "POSITION",
    "children",
    "nodes",
}
"""Keys of a glTF whose numbers must not be negative; Python would count from the end."""

MOST_NODES, DEEPEST_NODE = 20_000, 50

FRAME = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Rotation from glTF's axes (y up, z toward the viewer) to those of simulators and of the marker (z up)."""

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
ROOT = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"

UNITS = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
"""Units of a model, in mm."""

LARGEST = 500_000_000
"""Maximum size of the unpacked model, in bytes."""

MOST_OBJECTS, DEEPEST = 20_000, 10

VOLUMES = "metadata/slic3r_pe_model.config"
"""Where PrusaSlicer finds the parts of a mesh, in lower case."""


class MeshObject(NamedTuple):
    """Triangles of one object: see `mesh.Triangles`."""

    corners: NDArray[Any]
    name: str = ""
    color: Color | None = None
    paints: NDArray[np.int64] | None = None
    palette: list[Color] = []  # noqa: RUF012  (never changed)


def _reply(meshes: list[MeshObject]) -> Found:
    arrays: dict[str, NDArray[Any]] = {f"corners{k}": each.corners for k, each in enumerate(meshes)}
    arrays |= {f"paints{k}": each.paints for k, each in enumerate(meshes) if each.paints is not None}
    objects = [{"name": each.name, "color": each.color, "palette": each.palette} for each in meshes]
    return {"objects": objects}, arrays


# --- STL --------------------------------------------------------------------------------------------------------------


def read_stl(data: bytes) -> Found:
    """Read the triangles of a binary or text STL; its normals are ignored."""
    # An STL has no unit, color or parts.
    count = int.from_bytes(data[80:84], "little")
    is_binary = len(data) >= 84 and len(data) == 84 + 50 * count
    if not is_binary:
        _check_text(data)
    elif not count:
        return _reply([])
    load_stl = _load_stl()
    with warnings.catch_warnings():
        # numpy only warns where it stops reading.
        warnings.simplefilter("error")
        try:
            found = load_stl(BytesIO(data))
        except (ValueError, DeprecationWarning):
            raise InputError("numbers", "something else", "export it again") from None
    bodies = [found] if "vertices" in found else list(found["geometry"].values())
    corners = [body["vertices"][body["faces"]] for body in bodies]
    whole = np.concatenate(corners) if corners else np.zeros((0, 3, 3))
    if not is_binary and len(whole) != data.lower().count(b"endfacet"):
        raise InputError("a complete STL", "triangles without three corners, or no end", "export it again")
    return _reply([MeshObject(whole)])


def _check_text(data: bytes) -> None:
    """Refuse anything but the keywords of a text STL, since trimesh skips unknown lines."""
    if data.lstrip()[:5].lower() != b"solid":
        count = int.from_bytes(data[80:84], "little")
        found = f"{len(data)} bytes where the header implies {84 + 50 * count}"
        raise InputError("a complete STL", found, "export it again")
    firsts = [line.split(None, 1)[0].lower() for line in data.splitlines() if line.strip()]
    if not set(firsts) <= STL_WORDS:
        raise InputError("an STL", "lines of another kind", "export it again")
    facets = firsts.count(b"endfacet")
    if facets > MOST_TRIANGLES:
        raise InputError(f"at most {MOST_TRIANGLES} triangles", str(facets), "export it with a larger tolerance")
    if firsts[-1] != b"endsolid" or firsts.count(b"vertex") != 3 * facets:
        raise InputError("a complete STL", "triangles without three corners, or no end", "export it again")


def _load_stl() -> Callable[[BytesIO], dict[str, Any]]:
    """Import trimesh's STL reader without the package's imports of scipy and networkx, which take 0.6 s."""
    found = importlib.util.find_spec("trimesh")
    assert found is not None
    package = types.ModuleType("trimesh")
    package.__path__ = list(found.submodule_search_locations or [])
    sys.modules["trimesh"] = package
    try:
        from trimesh.exchange.stl import load_stl
    finally:
        # A later import loads the whole package.
        for each in [each for each in sys.modules if each.partition(".")[0] == "trimesh"]:
            del sys.modules[each]
    return load_stl


# --- GLB --------------------------------------------------------------------------------------------------------------


def read_glb(data: bytes) -> Found:
    """Read the meshes of a GLB's scene, in mm, marker frame; the primitives of a mesh differ in material."""
    _check_glb(data)
    try:
        from trimesh.exchange.gltf import load_glb
        from trimesh.scene.transforms import SceneGraph

        found = load_glb(BytesIO(data))
        graph = SceneGraph(base_frame=found["base_frame"])
        for edge in found["graph"]:
            graph.update(**edge)
        # The primitives of one mesh hang below a node of their own.
        groups: dict[str, list[tuple[str, dict[str, Any]]]] = {}
        for edge in found["graph"]:
            if "geometry" in edge and "faces" in (geometry := found["geometry"][edge["geometry"]]):
                several = geometry["metadata"]["from_gltf_primitive"]
                groups.setdefault(edge["frame_from" if several else "frame_to"], []).append(
                    (edge["frame_to"], geometry)
                )
        return _reply([_glb_mesh(name, primitives, graph) for name, primitives in groups.items()])
    except ImportError:
        raise
    except Exception:  # It raises whatever comes up in a broken file.
        raise InputError("a complete GLB", "inconsistent parts", "export it again") from None


def _glb_mesh(name: str, primitives: list[tuple[str, dict[str, Any]]], graph: Any) -> MeshObject:
    corners, paints, palette = [], [], []
    for number, (frame, geometry) in enumerate(primitives):
        matrix = np.asarray(graph[frame][0], dtype=float)
        places = np.asarray(geometry["vertices"])
        if places.dtype.kind != "f" or places.shape[1:] != (3,) or geometry["faces"].dtype.kind not in "iu":
            raise ValueError(places.dtype)
        moved = (places.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]) @ FRAME.T
        faces = geometry["faces"].astype(np.int64)
        corners.append(1e3 * moved[faces if np.linalg.det(matrix[:3, :3]) > 0 else faces[:, ::-1]])
        paints.append(np.full(len(faces), number))
        material = getattr(geometry.get("visual"), "material", None)
        factor = getattr(material, "baseColorFactor", None)
        shown = None if material is None else (1.0, 1.0, 1.0) if factor is None else tuple(np.ravel(factor)[:3] / 255.0)
        palette.append(shown)
    every, paint = np.concatenate(corners), np.concatenate(paints)
    # Most triangles determine the color of the part.
    main = int(np.argmax(np.bincount(paint, minlength=1)))
    colors = [color for color in palette if color is not None]
    if len(colors) < len(palette):
        return MeshObject(every, name, palette[main])
    return MeshObject(every, name, palette[main], np.where(paint == main, -1, paint), colors)


def _check_glb(data: bytes) -> None:
    """Refuse what trimesh would accept: wrong lengths and indices, extensions, external files, cycles of nodes."""
    if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
        raise InputError("a GLB of glTF 2.0", brief(repr(data[:8])), "export it again")
    if int.from_bytes(data[8:12], "little") != len(data):
        raise InputError("a complete GLB", f"{len(data)} bytes", "export it again")
    try:
        document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
        if required := document.get("extensionsRequired"):
            raise InputError("a GLB without extensions", brief(str(required)), "export it without them")
        if any("uri" in each for each in document.get("buffers", [])):
            raise InputError("one file", "a buffer in another file", "export it as one GLB")
        _check_indices(document, "")
        if any("bufferView" not in each or "sparse" in each for each in document.get("accessors", [])):
            raise ValueError("sparse")
        todo = [(node, 0) for node in document["scenes"][document.get("scene", 0)]["nodes"]]
        for node, depth in todo:
            if depth > DEEPEST_NODE or len(todo) > MOST_NODES:
                raise InputError(f"at most {MOST_NODES} nodes", "more, or a cycle", "check it")
            todo += [(child, depth + 1) for child in document["nodes"][node].get("children", [])]
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError):
        raise InputError("a complete GLB", "inconsistent parts", "export it again") from None


def _check_indices(value: Any, key: str) -> None:
    if isinstance(value, dict):
        for name, each in value.items():
            _check_indices(each, name)
    elif isinstance(value, list):
        for each in value:
            _check_indices(each, key)
    elif key in INDICES and isinstance(value, int) and value < 0:
        raise ValueError(key)


# --- 3MF --------------------------------------------------------------------------------------------------------------


@dataclass
class _Volume:
    """Range of an object's triangles that PrusaSlicer takes as a part, and the number of its extruder."""

    first: int
    last: int
    name: str = ""
    extruder: str = ""


@dataclass
class _Object:
    """An object being read: a mesh, or components (object, transform)."""

    name: str
    paint: tuple[str, int] | None
    vertices: list[tuple[float, float, float]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)
    paints: list[tuple[str, int] | None] = field(default_factory=list)
    components: list[tuple[str, Array]] = field(default_factory=list)


def read_3mf(data: bytes) -> Found:
    """Read the objects in the build of a 3MF, in mm, with the colors of their base materials.

    A mesh that PrusaSlicer would split into parts is split likewise.
    """
    data, volumes = _unpacked(data)
    model = _Model()
    model.read(data)
    if volumes is not None:
        model.read_volumes(volumes)
    return _reply(model.built())


def _unpacked(data: bytes) -> tuple[bytes, bytes | None]:
    """Unpack the model that the package's relationships name, and the ranges of its parts if it has any."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as package:
            names = {info.filename.lower(): info for info in package.infolist()}
            links = names.get("_rels/.rels")
            path = "3d/3dmodel.model"
            if links is not None and links.file_size < 1_000_000:
                path = _root(package.read(links)) or path
            info = names.get(path.lower())
            if info is None:
                raise InputError("a 3MF", "a package without a model", "export it again")
            volumes = names.get(VOLUMES)
            if max(info.file_size, volumes.file_size if volumes else 0) > LARGEST:
                raise InputError(f"a model of at most {LARGEST >> 20} MB", "a larger one", "export it again")
            return package.read(info), package.read(volumes) if volumes else None
    # zipfile raises these for broken packages, and the errors of zlib and struct below.
    except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, NotImplementedError, ValueError, KeyError) as error:
        raise InputError("a 3MF", f"a broken package: {brief(str(error))}", "export it again") from None
    except Exception as error:
        if type(error).__name__ == "error":  # struct.error and zlib.error
            raise InputError("a complete 3MF", "a broken package", "export it again") from None
        raise


def _root(data: bytes) -> str | None:
    found: list[str] = []

    def start(tag: str, attributes: Attributes) -> None:
        if tag.endswith(" Relationship") and attributes.get("Type") == ROOT:
            found.append(posixpath.normpath(attributes.get("Target", "")).lstrip("/"))

    _parse(data, start, lambda _: None)
    return found[0] if found else None


def _parse(data: bytes, start: Callable[[str, Attributes], None], end: Callable[[str], None]) -> None:
    """Parse XML, refusing document types and thus entities; names are ``namespace name``."""
    parser = expat.ParserCreate(namespace_separator=" ")

    def refuse(*_: object) -> NoReturn:
        raise InputError("plain XML", "a document type", "export it again")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError("complete XML", brief(str(error)), "export it again") from None
    except (ValueError, KeyError, OverflowError):
        raise InputError("the numbers of a 3MF", "missing or invalid ones", "export it again") from None


class _Model:
    """Model of a 3MF, collected while its XML is parsed."""

    def __init__(self) -> None:
        self.unit = 1.0
        self.colors: dict[str, list[Color]] = {}
        self.objects: dict[str, _Object] = {}
        self.items: list[tuple[str, Array]] = []
        self.volumes: dict[str, list[_Volume]] = {}
        self._materials: list[Color] = []
        self._object: _Object | None = None
        self._volumes: list[_Volume] = []

    def read(self, data: bytes) -> None:
        """Collect objects, materials and build items."""
        _parse(data, self._start, self._end)

    def read_volumes(self, data: bytes) -> None:
        """Collect the ranges of triangles that PrusaSlicer takes as parts."""
        _parse(data, self._start_volumes, lambda _: None)

    def _start_volumes(self, tag: str, given: Attributes) -> None:
        if tag == "object":
            self._volumes = self.volumes.setdefault(given["id"], [])
        elif tag == "volume":
            self._volumes.append(_Volume(int(given["firstid"]), int(given["lastid"])))
            if len(self._volumes) > MOST_OBJECTS:
                raise InputError(f"at most {MOST_OBJECTS} parts", "more", "export it again")
        elif tag == "metadata" and given.get("type") == "volume" and given.get("key") in ("name", "extruder"):
            setattr(self._volumes[-1], given["key"], given["value"])

    def _start(self, tag: str, given: Attributes) -> None:
        space, _, word = tag.rpartition(" ")
        if space != CORE:
            return
        current = self._object
        if word == "vertex" and current:
            current.vertices.append((float(given["x"]), float(given["y"]), float(given["z"])))
        elif word == "triangle" and current:
            current.triangles.append((int(given["v1"]), int(given["v2"]), int(given["v3"])))
            group = given.get("pid", current.paint[0] if current.paint else "")
            current.paints.append((group, int(given["p1"])) if "p1" in given else None)
            if len(current.triangles) > MOST_TRIANGLES:
                raise InputError(f"at most {MOST_TRIANGLES} triangles", "more", "export it with a larger tolerance")
        elif word == "model":
            unit = given.get("unit", "millimeter")
            if unit not in UNITS:
                raise InputError("a unit of length", brief(unit), f"use one of {', '.join(UNITS)}")
            self.unit = UNITS[unit]
        elif word == "basematerials":
            self._materials = self.colors.setdefault(given["id"], [])
        elif word == "base":
            self._materials.append(_color(given["displaycolor"]))
        elif word == "object":
            paint = (given["pid"], int(given.get("pindex", "0"))) if "pid" in given else None
            self._object = self.objects[given["id"]] = _Object(given.get("name", ""), paint)
            if len(self.objects) > MOST_OBJECTS:
                raise InputError(f"at most {MOST_OBJECTS} objects", "more", "export it again")
        elif word == "component" and current:
            current.components.append((given["objectid"], _transform(given.get("transform"))))
        elif word == "item":
            self.items.append((given["objectid"], _transform(given.get("transform"))))

    def _end(self, tag: str) -> None:
        if tag == f"{CORE} object":
            self._object = None

    def built(self) -> list[MeshObject]:
        """Triangles in mm of all build items; of a single item, without its shift, which is its place on the bed."""
        found: list[MeshObject] = []
        if len(self.items) == 1:
            self.items[0][1][3, :3] = 0
        for key, transform in self.items:
            self._add(found, key, transform, 0)
        return found

    def _add(self, found: list[MeshObject], key: str, transform: Array, depth: int) -> None:
        each = self.objects.get(key)
        if each is None or depth > DEEPEST or len(found) > MOST_OBJECTS:
            raise InputError("objects that exist", f"object {brief(key)}", "export it again")
        for part, move in each.components:
            # Points are rows, so the leftmost transform applies first.
            self._add(found, part, move @ transform, depth + 1)
        if not each.triangles:
            return
        triangles = np.array(each.triangles)
        if triangles.min() < 0 or triangles.max() >= len(each.vertices):
            raise InputError("triangles between corners", "a corner that is missing", "export it again")
        vertices = np.column_stack([np.array(each.vertices), np.ones(len(each.vertices))]) @ transform
        corners = self.unit * vertices[triangles][:, :, :3]
        if np.linalg.det(transform[:3, :3]) < 0:
            corners = corners[:, ::-1]
        palette = [color for colors in self.colors.values() for color in colors]
        first, index = 0, {}
        for paint, colors in self.colors.items():
            index.update({(paint, k): first + k for k in range(len(colors))})
            first += len(colors)
        own = index.get(each.paint, -1) if each.paint else -1
        paints = np.array([index.get(paint, -1) if paint else own for paint in each.paints])
        volumes = self.volumes.get(key, [])
        materials = []
        for volume in volumes or [_Volume(0, len(paints) - 1, each.name)]:
            piece = slice(volume.first, volume.last + 1)
            seen = paints[piece]
            # Most triangles determine the color of a part.
            main = int(np.bincount(seen + 1).argmax()) - 1 if volumes and len(seen) else own
            materials.append(main)
            color = palette[main] if main >= 0 else None
            found.append(MeshObject(corners[piece], volume.name, color, np.where(seen == main, -1, seen), palette))
        if volumes:
            _check_volumes(volumes, len(paints), materials)


def _check_volumes(volumes: list[_Volume], count: int, materials: list[int]) -> None:
    """Refuse ranges that are not all of the triangles, each once, and materials without an extruder of their own."""
    ends = [-1, *(volume.last for volume in volumes)]
    starts = [*(volume.first for volume in volumes), count]
    if any(start != end + 1 for start, end in zip(starts, ends, strict=True)):
        raise InputError("all triangles in parts for PrusaSlicer", "other ranges of them", "export it again")
    pairs = {(material, volume.extruder) for material, volume in zip(materials, volumes, strict=True)}
    if len(pairs) != len(set(materials)) or len({extruder for _, extruder in pairs}) != len(pairs):
        raise InputError("one extruder for each material in PrusaSlicer", "others", "export it again")


def _transform(text: str | None) -> Array:
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
