"""Parsers of mesh files; `markergen.guard` runs this script in a child process for `mesh`.

trimesh parses STL. Because it accepts malformed files, the keywords of a text STL are checked first.
"""

import importlib.util
import sys
import types
import warnings
from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.guard import MOST_TRIANGLES
from markergen.read.meshes import MeshObject, threemf
from markergen.read.meshes import glb as gltf

Found = tuple[dict[str, Any], dict[str, NDArray[Any]]]
"""Names and colors of a file's objects, and arrays keyed ``corners`` or ``paints`` plus the object's number."""

STL_WORDS = {b"solid", b"endsolid", b"facet", b"outer", b"vertex", b"endloop", b"endfacet"}


def read_glb(data: bytes) -> Found:
    """Read the meshes of a GLB's scene."""
    return _reply(gltf.read_glb(data))


def read_3mf(data: bytes) -> Found:
    """Read the objects in the build of a 3MF."""
    return _reply(threemf.read_3mf(data))


def _reply(meshes: list[MeshObject]) -> Found:
    arrays: dict[str, NDArray[Any]] = {f"corners{k}": each.corners for k, each in enumerate(meshes)}
    arrays |= {f"paints{k}": each.paints for k, each in enumerate(meshes) if each.paints is not None}
    objects = [{"name": each.name, "color": each.color, "palette": each.palette, "tool": each.tool} for each in meshes]
    return {"objects": objects}, arrays


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
