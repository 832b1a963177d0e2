"""3MF: objects with materials, moved to where the build and their components have them."""

import posixpath
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.model.marker import Marker
from markergen.solid.surface import Color
from markergen.verification.mesh import MOST_TRIANGLES, TOLERANCE, Triangles, surface_of
from markergen.verification.reading import READERS, Reading
from markergen.verification.solids import reading_of

Array = NDArray[np.float64]
Attributes = dict[str, str]

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
ROOT = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"

UNITS = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
"""mm of the units that a model may be in."""

LARGEST = 500_000_000
"""Bytes of the model once it is unpacked."""

MOST_OBJECTS, DEEPEST = 20_000, 10


@dataclass
class _Object:
    """One object as it is read: a mesh, or components (object, transform)."""

    name: str
    paint: tuple[str, int] | None
    vertices: list[tuple[float, float, float]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)
    paints: list[tuple[str, int] | None] = field(default_factory=list)
    components: list[tuple[str, Array]] = field(default_factory=list)


@READERS.register(".3mf")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Objects of a 3MF that its build has, in mm, each with the colors of its base materials."""
    model = _Model(name)
    model.read(_unpacked(data, name))
    return reading_of("3MF", surface_of(model.built(), name), TOLERANCE)


def _unpacked(data: bytes, name: str) -> bytes:
    """The package's model, which its relationships name."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as package:
            names = {info.filename.lower(): info for info in package.infolist()}
            links = names.get("_rels/.rels")
            path = "3d/3dmodel.model"
            if links is not None and links.file_size < 1_000_000:
                path = _root(package.read(links), name) or path
            info = names.get(path.lower())
            if info is None:
                raise InputError(f"a 3MF in {name}", "a package without a model", "export it again")
            if info.file_size > LARGEST:
                raise InputError(f"a model of at most {LARGEST >> 20} MB in {name}", "a larger one", "export it again")
            return package.read(info)
    # What zipfile raises at broken packages: BadZipFile, and of zlib, of encryption, of methods, of structures.
    except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, NotImplementedError, ValueError, KeyError) as error:
        raise InputError(
            f"a 3MF in {name}", f"a package that is none: {brief(str(error))}", "export it again"
        ) from None
    except Exception as error:
        if type(error).__name__ == "error":  # struct.error and zlib.error
            raise InputError(f"a complete 3MF in {name}", "a broken package", "export it again") from None
        raise


def _root(data: bytes, name: str) -> str | None:
    found: list[str] = []

    def start(tag: str, attributes: Attributes) -> None:
        if tag.endswith(" Relationship") and attributes.get("Type") == ROOT:
            found.append(posixpath.normpath(attributes.get("Target", "")).lstrip("/"))

    _parse(data, start, lambda _: None, name)
    return found[0] if found else None


def _parse(data: bytes, start: Callable[[str, Attributes], None], end: Callable[[str], None], name: str) -> None:
    """Follow XML without entities or document types; names are ``namespace name``."""
    parser = expat.ParserCreate(namespace_separator=" ")

    def refuse(*_: object) -> NoReturn:
        raise InputError(f"plain XML in {name}", "a document type", "export it again")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"complete XML in {name}", brief(str(error)), "export it again") from None
    except (ValueError, KeyError, OverflowError):
        raise InputError(f"numbers where a 3MF has them in {name}", "none, or others", "export it again") from None


class _Model:
    """The model of a 3MF, collected while its XML is read."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.unit = 1.0
        self.colors: dict[str, list[Color]] = {}
        self.objects: dict[str, _Object] = {}
        self.items: list[tuple[str, Array]] = []
        self._materials: list[Color] = []
        self._object: _Object | None = None

    def read(self, data: bytes) -> None:
        """Collect objects, materials and what is built."""
        _parse(data, self._start, self._end, self.name)

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
                raise InputError(f"at most {MOST_TRIANGLES} triangles in {self.name}", "more", "export it coarser")
        elif word == "model":
            unit = given.get("unit", "millimeter")
            if unit not in UNITS:
                raise InputError(f"a unit of length in {self.name}", brief(unit), f"use one of {', '.join(UNITS)}")
            self.unit = UNITS[unit]
        elif word == "basematerials":
            self._materials = self.colors.setdefault(given["id"], [])
        elif word == "base":
            self._materials.append(_color(given["displaycolor"]))
        elif word == "object":
            paint = (given["pid"], int(given.get("pindex", "0"))) if "pid" in given else None
            self._object = self.objects[given["id"]] = _Object(given.get("name", ""), paint)
            if len(self.objects) > MOST_OBJECTS:
                raise InputError(f"at most {MOST_OBJECTS} objects in {self.name}", "more", "export it again")
        elif word == "component" and current:
            current.components.append((given["objectid"], _transform(given.get("transform"))))
        elif word == "item":
            self.items.append((given["objectid"], _transform(given.get("transform"))))

    def _end(self, tag: str) -> None:
        if tag == f"{CORE} object":
            self._object = None

    def built(self) -> list[Triangles]:
        """Triangles in mm of everything that is built."""
        found: list[Triangles] = []
        for key, transform in self.items:
            self._add(found, key, transform, 0)
        return found

    def _add(self, found: list[Triangles], key: str, transform: Array, depth: int) -> None:
        each = self.objects.get(key)
        if each is None or depth > DEEPEST or len(found) > MOST_OBJECTS:
            raise InputError(f"objects that there are in {self.name}", f"object {brief(key)}", "export it again")
        for part, move in each.components:
            # Rows times matrices: what is said first is done first.
            self._add(found, part, move @ transform, depth + 1)
        if not each.triangles:
            return
        triangles = np.array(each.triangles)
        if triangles.min() < 0 or triangles.max() >= len(each.vertices):
            raise InputError(f"triangles between corners in {self.name}", "a corner that is missing", "export it again")
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
        paints[paints == own] = -1
        found.append(Triangles(corners, each.name, palette[own] if own >= 0 else None, paints, palette))


def _transform(text: str | None) -> Array:
    """Matrix (4, 4) that rows are multiplied with, of its twelve numbers."""
    matrix = np.eye(4)
    if text is not None:
        matrix[:, :3] = np.array([float(word) for word in text.split()]).reshape(4, 3)
    return matrix


def _color(text: str) -> Color:
    """Red, green, blue of ``#RRGGBB`` or ``#RRGGBBAA``."""
    if not (text.startswith("#") and len(text) in (7, 9)):
        raise ValueError(text)
    red, green, blue = (int(text[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
