"""Read the bodies of STL, 3MF, GLB, STEP and BREP files as triangles, in a child process.

Open CASCADE crashes on some broken files and never finishes on others.
"""

# tests: tests/verification/test_solid_readers.py

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

import markergen.read.meshes
from markergen.arrays import Array, Mask
from markergen.errors import InputError, MissingLibraryError
from markergen.guard import MOST_TRIANGLES, Content, Reply, in_child, start_child
from markergen.occt import missing_kernel
from markergen.read.meshes import MeshObject
from markergen.verification.rays import Shell
from markergen.verification.rims import welded

FOLDER = Path(markergen.read.meshes.__file__)
MESH_PARSER, PARSER = FOLDER.with_name("mesh_parser.py"), FOLDER.with_name("step_parser.py")

HUGE = re.compile(rb"'[^']*'|(\d\.?\d*[eE]\+?0*[1-9]\d|\d{12}\.)")
"""Quoted strings, to skip, and numbers beyond 1e10 outside of them, on which Open CASCADE never finishes."""

CONTRAST = 0.2
"""Minimum difference of lightness between dark and light, where black is 0 and white is 1."""

LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, eq=False)
class Solid:
    """What is in a file.

    Attributes
    ----------
    objects : tuple of MeshObject
    flaws : tuple of str
        What is wrong with these by themselves.
    """

    objects: tuple[MeshObject, ...]
    flaws: tuple[str, ...] = ()

    @cached_property
    def shell(self) -> Shell:
        """All triangles, with the index of their object."""
        corners = np.concatenate([mesh.corners for mesh in self.objects])
        owner = np.repeat(np.arange(len(self.objects)), [len(mesh.corners) for mesh in self.objects])
        return Shell(corners, owner, self._dark())

    def _dark(self) -> Mask | None:
        """Whether each triangle is dark, where those without a color are light; None if none has one."""
        lightness = []
        for mesh in self.objects:
            lightness_of_mesh = np.nan if mesh.color is None else float(LUMA @ np.array(mesh.color))
            levels = np.array([*(float(LUMA @ np.array(color)) for color in mesh.palette), lightness_of_mesh])
            lightness.append(levels[np.full(len(mesh.corners), -1) if mesh.paints is None else mesh.paints])
        levels = np.concatenate(lightness)
        if not np.isfinite(levels).any():
            return None
        levels = np.nan_to_num(levels, nan=1.0)
        spread = float(np.ptp(levels)) if len(levels) else 0.0
        return np.asarray(levels < (levels.max() + levels.min()) / 2 if spread >= CONTRAST else levels < 0.5)

    def mapped(self, matrix: Array, translation: Array | float = 0.0) -> "Solid":
        """Map by a matrix (3, 3), inside out again if it mirrors, and a translation in mm."""
        flip = slice(None, None, -1 if np.linalg.det(matrix) < 0 else 1)
        objects = (mesh._replace(corners=(mesh.corners @ matrix.T + translation)[:, flip]) for mesh in self.objects)
        return Solid(tuple(objects))


CAD = ("STEP", "BREP")
"""Kinds of files of surfaces, whose edges the kernel has looked at."""


def read_solid(kind: str, data: bytes, name: str) -> Solid:
    """Read the triangles of an STL, the objects in the build of a 3MF, the meshes in the scene of a GLB, or CAD parts.

    Raises InputError if it is not a complete one, or has too many triangles or corners that are not finite or lie
    beyond 10 km; MissingLibraryError if it is a CAD file, and the CAD kernel or one of its libraries is missing.
    """
    if kind in CAD:
        reply = _cad(kind, data, name)
    else:
        start_child(MESH_PARSER, "mesh")
        # Imported early, to load while the child starts.
        import scipy.sparse.csgraph  # noqa: F401

        wanted = f"a {kind} in {name}"
        reply = in_child(MESH_PARSER, f"read_{kind.lower()}", Content(name, data), "mesh", wanted)
    values, arrays = reply.values, reply.arrays
    objects = []
    for number, mesh in enumerate(values["objects"]):
        color, palette = mesh["color"], [(red, green, blue) for red, green, blue in mesh["palette"]]
        corners, paints = arrays[f"corners{number}"].astype(float), arrays.get(f"paints{number}")
        color = tuple(color) if color else None
        objects.append(MeshObject(corners, mesh["name"], color, paints, palette, mesh["tool"]))
    count = sum(len(mesh.corners) for mesh in objects)
    if not count:
        raise InputError(f"triangles in {name}", "none", "export it again")
    if count > MOST_TRIANGLES:
        raise InputError(
            f"at most {MOST_TRIANGLES} triangles in {name}", str(count), "export it with a larger tolerance"
        )
    if not all((np.abs(mesh.corners) < 1e7).all() for mesh in objects):
        raise InputError(f"corners within 10 km in {name}", "numbers beyond that or not finite", "export it again")
    return Solid(tuple(objects), tuple(values["flaws"]))


def _cad(kind: str, data: bytes, name: str) -> Reply:
    if kind == "BREP" and b"CASCADE Topology" not in data[:1000]:
        raise InputError(f"a BREP file of Open CASCADE in {name}", "something else", "export it again")
    # Blanks may follow the end; Open CASCADE would read a truncated file as far as it goes.
    if kind == "STEP" and (not data.lstrip().startswith(b"ISO-10303-21") or b"END-ISO-10303-21" not in data[-1000:]):
        raise InputError(f"a complete STEP file in {name}", "no header or no end", "export it again")
    if kind == "STEP" and any(match[1] for match in HUGE.finditer(data)):
        raise InputError(f"lengths below 10 000 km in {name}", "numbers beyond 1e10", "export it again")
    wanted = f"a {kind} file that Open CASCADE reads in {name}"
    try:
        reply = in_child(PARSER, kind.lower(), Content(name, data), "CAD", wanted)
    except MissingLibraryError as error:
        raise missing_kernel("reading solids needs", str(error)) from None
    if not reply.values["objects"]:
        raise InputError(f"shapes in {name}", "none", "export it again")
    return reply


def open_edges(corners: Array) -> bool:
    """Tell whether triangles (m, 3, 3) have edges without a neighbor."""
    places, triangles = welded(corners)
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    count = len(places)
    forward, backward = np.sort(start * count + end), np.sort(end * count + start)
    return not np.array_equal(forward, backward)
