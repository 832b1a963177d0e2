"""STL, binary and text: triangles without unit, color or parts."""

import numpy as np

from markergen.errors import InputError
from markergen.model.marker import Marker
from markergen.verification.mesh import MOST_TRIANGLES, TOLERANCE, Triangles, surface_of
from markergen.verification.reading import READERS, Reading
from markergen.verification.solids import reading_of

HEADER = 84
"""Bytes before the first triangle: 80 of anything, and the count."""

ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])


@READERS.register(".stl")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Triangles of an STL in mm; the normals that it tells are not asked."""
    count = int.from_bytes(data[80:HEADER], "little")
    if len(data) >= HEADER and len(data) == HEADER + ROW.itemsize * count:
        corners = np.frombuffer(data, ROW, count, HEADER)["corners"].astype(float)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _of_text(data, name)
    else:
        found = f"{len(data)} bytes that say they are {count}"
        raise InputError(f"a complete STL in {name}", found, "export it again")
    return reading_of("STL", surface_of([Triangles(corners)], name), TOLERANCE)


def _of_text(data: bytes, name: str) -> np.ndarray:
    """Corners (m, 3, 3) of a text: solid NAME, facets, endsolid NAME; perhaps several one after the other."""
    vertices: list[list[bytes]] = []
    facets = 0
    for line in data.splitlines():
        words = line.split()
        if not words:
            continue
        key = words[0].lower()
        if key == b"vertex" and len(words) == 4:
            vertices.append(words[1:])
        elif key == b"endfacet":
            facets += 1
        elif key not in (b"solid", b"endsolid", b"facet", b"outer", b"endloop"):
            raise InputError(f"an STL in {name}", "lines that are not of one", "export it again")
        if facets > MOST_TRIANGLES:
            break
    if len(vertices) != 3 * facets or not data.rstrip().splitlines()[-1].split()[0].lower() == b"endsolid":
        raise InputError(f"a complete STL in {name}", "triangles without three corners, or no end", "export it again")
    try:
        return np.array(vertices, dtype=float).reshape(-1, 3, 3)
    except ValueError:
        raise InputError(f"numbers in {name}", "something else", "export it again") from None
