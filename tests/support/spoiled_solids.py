"""Ways to spoil files of solids that share nothing with those that write or read them."""

import json
import re
import struct
import zipfile
from io import BytesIO

import numpy as np

SOLIDS = (".step", ".stl", ".3mf", ".glb")


def resized(data, suffix, x, y=None, z=None):
    """The same file with all its content x, y, z times as large; a STEP only in all directions alike."""
    return {".step": _step, ".stl": _stl, ".3mf": _3mf, ".glb": _glb}[suffix](data, x, x if y is None else y, z or x)


def triangles(data):
    """Corners (m, 3, 3) of a binary STL."""
    rows = np.frombuffer(data, np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]), offset=84)
    return rows["c"].astype(float)


def stl(corners):
    """Binary STL of triangles (m, 3, 3)."""
    rows = np.zeros(len(corners), np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    rows["c"] = corners
    return bytes(80) + struct.pack("<I", len(corners)) + rows.tobytes()


def stl_of_text(corners):
    """Text STL of triangles (m, 3, 3)."""
    lines = ["solid marker"]
    for triangle in corners.tolist():
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in triangle)]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid marker", ""]).encode()


def gltf(data):
    """JSON of a GLB, and the bytes after it."""
    size = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + size]), data[20 + size :]


def glb(document, rest):
    """GLB of its JSON and the bytes after it."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return (
        struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
        + struct.pack("<II", len(text), 0x4E4F534A)
        + text
        + rest
    )


def model(data):
    """XML of a 3MF's model."""
    with zipfile.ZipFile(BytesIO(data)) as package:
        return package.read("3D/3dmodel.model").decode()


def with_model(data, text, path="3D/3dmodel.model"):
    """The 3MF with another model, or another file; without that file if there is no text."""
    out = BytesIO()
    with zipfile.ZipFile(BytesIO(data)) as package, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as changed:
        for name in package.namelist():
            if name != path:
                changed.writestr(name, package.read(name))
            elif text:
                changed.writestr(name, text)
    return out.getvalue()


def _stl(data, x, y, z):
    return stl(triangles(data) * [x, y, z])


def _glb(data, x, y, z):
    document, rest = gltf(data)
    nodes = document["nodes"]
    # In the marker's own frame, below the node that turns it.
    for child in nodes[0]["children"]:
        nodes[child]["scale"] = [x, y, z]
    return glb(document, rest)


def _3mf(data, x, y, z):
    text = model(data)
    moved = rf'\1 transform="{x} 0 0 0 {y} 0 0 0 {z} 0 0 0"/>'
    changed = re.sub(r'(<item objectid="\d+")[^>]*/>', moved, text)
    assert changed != text
    return with_model(data, changed)


def _step(data, x, y, z):
    assert x == y == z
    text = data.decode()

    def times(match):
        numbers = re.sub(r"[-+]?\d+\.\d*(?:[eE][-+]?\d+)?", lambda number: repr(float(number[0]) * x), match[2])
        return match[1] + numbers + match[3]

    text = re.sub(r"(CARTESIAN_POINT\('',\()([^)]*)(\))", times, text)
    text = re.sub(r"((?:CIRCLE|CYLINDRICAL_SURFACE|SPHERICAL_SURFACE)\('',#\d+,)([^)]*)(\))", times, text)
    text = re.sub(r"(CONICAL_SURFACE\('',#\d+,)([^,)]*)(,)", times, text)  # Its angle stays.
    return text.encode()
