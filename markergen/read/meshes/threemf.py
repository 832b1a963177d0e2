"""Objects in the build of a 3MF, with the colors of their base materials and with PrusaSlicer's parts of them."""

import posixpath
import struct
import zipfile
import zlib
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.guard import MOST_TRIANGLES
from markergen.read.meshes import LONGEST, MOST_OBJECTS, Color, MeshObject

Array = NDArray[np.float64]
Attributes = dict[str, str]

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
ROOT = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
VOLUMES = "metadata/slic3r_pe_model.config"
"""Where PrusaSlicer finds the parts of a mesh: ranges of triangles, with names and extruders."""

UNITS = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
"""Units of a model, in mm."""

LARGEST = 200_000_000
"""Maximum size of the unpacked model, in bytes."""

PIECE = 1 << 18
"""Number of bytes that are unpacked and parsed at a time, and the maximum size of an XML tag."""

MOST_ENTRIES = 1_000
"""Maximum number of files in a 3MF, which has some ten."""

DEEPEST = 10
"""Maximum depth of components in components."""

MOST_CORNERS = MOST_TRIANGLES
"""A closed mesh has half as many corners as triangles."""


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


def read_3mf(data: bytes) -> list[MeshObject]:
    """Read the objects in the build of a 3MF, in mm."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as package:
            infos = package.infolist()
            if len(infos) > MOST_ENTRIES:
                raise InputError(f"at most {MOST_ENTRIES} files in a 3MF", str(len(infos)), "export it again")
            names = {info.filename.lower(): info for info in infos}
            root = _Root()
            if links := names.get("_rels/.rels"):
                _parse(_pieces(package, links), root.start, lambda _: None)
            info = names.get(root.path.lower())
            if info is None:
                raise InputError("a 3MF", "a package without a model", "export it again")
            if info.file_size > LARGEST:
                raise InputError(f"a model of at most {LARGEST // 10**6} MB", "a larger one", "export the marker alone")
            model = _Model()
            _parse(_pieces(package, info), model.start, model.end)
            ranges = _Ranges()
            if volumes := names.get(VOLUMES):
                _parse(_pieces(package, volumes), ranges.start, ranges.end)
    # zipfile, zlib and struct raise these for broken packages; RuntimeError is for encrypted ones.
    except (zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, RuntimeError) as error:
        raise InputError("a 3MF", f"a broken package: {brief(str(error))}", "export it again") from None
    return model.built(ranges.volumes)


def _pieces(package: zipfile.ZipFile, info: zipfile.ZipInfo) -> Iterator[bytes]:
    """Unpack an entry piece by piece; raises InputError beyond `LARGEST`, whatever size it declares."""
    left = LARGEST
    with package.open(info) as stream:
        while piece := stream.read(PIECE):
            left -= len(piece)
            if left < 0:
                raise InputError(f"a model of at most {LARGEST // 10**6} MB", "a larger one", "export the marker alone")
            yield piece


def _parse(pieces: Iterable[bytes], start: Callable[[str, Attributes], None], end: Callable[[str], None]) -> None:
    """Parse XML, refusing document types and thus entities, and endless tags; names are ``namespace name``."""
    parser = expat.ParserCreate(namespace_separator=" ")

    def refuse(*_: object) -> NoReturn:
        raise InputError("plain XML", "a document type", "export it again")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    fed = 0
    try:
        for piece in pieces:
            parser.Parse(piece, False)
            fed += len(piece)
            if fed - parser.CurrentByteIndex > 2 * PIECE:
                raise InputError("plain XML", "a tag or text without an end", "export it again")
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise InputError("complete XML", brief(str(error)), "export it again") from None
    except (ValueError, KeyError, OverflowError):
        raise InputError("the numbers of a 3MF", "missing or invalid ones", "export it again") from None


class _Root:
    """Path of the model that a package's relationships name."""

    def __init__(self) -> None:
        self.path = "3d/3dmodel.model"

    def start(self, tag: str, attributes: Attributes) -> None:
        if tag.endswith(" Relationship") and attributes.get("Type") == ROOT:
            self.path = posixpath.normpath(attributes.get("Target", self.path)).lstrip("/")


class _Ranges:
    """PrusaSlicer's parts by the number of their object."""

    def __init__(self) -> None:
        self.volumes: dict[str, list[_Volume]] = {}
        self._object = ""

    def start(self, tag: str, given: Attributes) -> None:
        own = self.volumes.setdefault(self._object, [])
        if tag == "object":
            self._object = given["id"]
        elif tag == "volume":
            if sum(map(len, self.volumes.values())) >= MOST_OBJECTS:
                raise InputError(f"at most {MOST_OBJECTS} parts", "more", "export it again")
            own.append(_Volume(int(given["firstid"]), int(given["lastid"]), "", ""))
        elif tag == "metadata" and own and given.get("type") == "volume":
            if given.get("key") == "name":
                own[-1] = own[-1]._replace(name=given["value"][:LONGEST])
            elif given.get("key") == "extruder":
                own[-1] = own[-1]._replace(tool=given["value"][:LONGEST])

    def end(self, tag: str) -> None:
        """Do nothing."""


class _Model:
    """Model of a 3MF, collected while its XML is parsed."""

    def __init__(self) -> None:
        self.unit = 1.0
        self.palette: list[Color] = []
        self.first: dict[str, int] = {}
        self.objects: dict[str, _Object] = {}
        self.items: list[tuple[str, Array]] = []
        self._current: _Object | None = None
        self._corners = self._triangles = self._components = self._steps = 0
        self._starts = {
            f"{CORE} {word}": getattr(self, f"_{word}")
            for word in ("vertex", "triangle", "model", "basematerials", "base", "object", "component", "item")
        }

    def start(self, tag: str, given: Attributes) -> None:
        """Collect objects, materials and build items."""
        if (known := self._starts.get(tag)) is not None:
            known(given)

    def end(self, tag: str) -> None:
        """Leave an object."""
        if tag == f"{CORE} object":
            self._current = None

    def _vertex(self, given: Attributes) -> None:
        if self._current:
            self._current.vertices.extend((float(given["x"]), float(given["y"]), float(given["z"])))
            self._corners += 1
            if self._corners > MOST_CORNERS:
                raise InputError(f"at most {MOST_CORNERS} corners", "more", "export it with a larger tolerance")

    def _triangle(self, given: Attributes) -> None:
        current = self._current
        if not current:
            return
        current.triangles.extend((int(given["v1"]), int(given["v2"]), int(given["v3"])))
        current.paints.append(
            self._paint(given.get("pid", current.group), given["p1"]) if "p1" in given else current.paint
        )
        self._triangles += 1
        if self._triangles > MOST_TRIANGLES:
            raise InputError(f"at most {MOST_TRIANGLES} triangles", "more", "export it with a larger tolerance")

    def _model(self, given: Attributes) -> None:
        unit = given.get("unit", "millimeter")
        if unit not in UNITS:
            raise InputError("a unit of length", brief(unit), f"use one of {', '.join(UNITS)}")
        self.unit = UNITS[unit]

    def _basematerials(self, given: Attributes) -> None:
        self.first[given["id"]] = len(self.palette)

    def _base(self, given: Attributes) -> None:
        self.palette.append(_color(given["displaycolor"]))
        self._bounded(len(self.palette), "materials")

    def _object(self, given: Attributes) -> None:
        group = given.get("pid", "")
        paint = self._paint(group, given.get("pindex", "0")) if group else -1
        self._current = self.objects[given["id"]] = _Object(given.get("name", "")[:LONGEST], paint, group)
        self._bounded(len(self.objects), "objects")

    def _paint(self, group: str, number: str) -> int:
        """Index of a material in the palette; -1 for none."""
        index = self.first.get(group, -1 - MOST_OBJECTS) + int(number)
        return index if 0 <= index < len(self.palette) else -1

    def _bounded(self, count: int, what: str) -> None:
        if count > MOST_OBJECTS:
            raise InputError(f"at most {MOST_OBJECTS} {what}", "more", "export it again")

    def _component(self, given: Attributes) -> None:
        if self._current:
            self._current.components.append((given["objectid"], _transform(given.get("transform"))))
            self._components += 1
            self._bounded(self._components, "components")

    def _item(self, given: Attributes) -> None:
        self.items.append((given["objectid"], _transform(given.get("transform"))))
        self._bounded(len(self.items), "items to build")

    def built(self, volumes: dict[str, list[_Volume]]) -> list[MeshObject]:
        """Triangles in mm of all build items; of a single one without its shift, which is its place on the bed."""
        placed: list[tuple[str, Array]] = []
        if len(self.items) == 1:
            self.items[0][1][3, :3] = 0
        for key, transform in self.items:
            self._place(placed, key, transform, 0)
        total = sum(len(self.objects[key].triangles) for key, _ in placed) // 3
        if total > MOST_TRIANGLES:
            raise InputError(f"at most {MOST_TRIANGLES} triangles", str(total), "export the marker alone")
        return [part for key, transform in placed for part in self._meshes(key, transform, volumes.get(key, []))]

    def _place(self, placed: list[tuple[str, Array]], key: str, transform: Array, depth: int) -> None:
        """Find the meshes of an object and their transforms, for at most `MOST_OBJECTS` steps."""
        each = self.objects.get(key)
        self._steps += 1
        if each is None or depth > DEEPEST or self._steps > MOST_OBJECTS:
            raise InputError("objects that exist", f"object {brief(key)}", "export it again")
        for part, move in each.components:
            # Points are rows, so the leftmost transform applies first.
            self._place(placed, part, move @ transform, depth + 1)
        if each.triangles:
            placed.append((key, transform))

    def _meshes(self, key: str, transform: Array, volumes: list[_Volume]) -> list[MeshObject]:
        each = self.objects[key]
        triangles = np.array(each.triangles).reshape(-1, 3)
        vertices = np.array(each.vertices).reshape(-1, 3)
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise InputError("triangles between corners", "a corner that is missing", "export it again")
        vertices = self.unit * (vertices @ transform[:3, :3] + transform[3, :3])
        corners = vertices[triangles if np.linalg.det(transform[:3, :3]) > 0 else triangles[:, ::-1]]
        paints = np.array(each.paints, dtype=np.int64)
        color = self.palette[each.paint] if each.paint >= 0 else None
        paints[paints == each.paint] = -1
        inside = [part for part in volumes if 0 <= part.first <= part.last < len(corners)]
        ranges = inside or [_Volume(0, len(corners) - 1, each.name, "")]
        return [
            MeshObject(
                corners[part.first : part.last + 1], part.name, color, paints[part.first : part.last + 1], self.palette,
                part.tool,
            )
            for part in ranges
        ]  # fmt: skip


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
