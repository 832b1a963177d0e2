"""Write contours as a file of the format that its name says: SVG, DXF or GeoJSON."""

# tests: tests/api/test_inspect.py

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from markergen.errors import InputError
from markergen.geometry.contour import Contour, box, mirrored, placed, radius_of
from markergen.geometry.outlines import polygons_of
from markergen.read.endings import by_ending
from markergen.read.outlines.dxf import without_time


def outline_bytes(contours: Sequence[Contour], path: Path) -> bytes:
    """Return contours in m as a file, in mm with its unit; GeoJSON, which has none, in m and without arcs.

    Raises InputError if the ending is unknown, or the format has no arcs and the contours have.
    """
    return check_outline_path(path)(contours).encode()


def check_outline_path(path: Path) -> Callable[[Sequence[Contour]], str]:
    """Return the writer that a file's name stands for, before any work is done for it; raises InputError."""
    return by_ending(WRITERS.items(), path, "an outline")[0]


def _svg(contours: Sequence[Contour]) -> str:
    # Mirrored, since y is down.
    drawn = [placed(mirrored(contour), 1000.0, (0.0, 0.0), 9) for contour in contours]
    boxes = np.array([box(contour) for contour in drawn])
    (left, top), (right, low) = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
    size = f"{right - left!r} {low - top!r}"
    width, height = (f"{side}mm" for side in size.split())
    paths = "".join(f'<path d="{_path(contour)}"/>\n' for contour in drawn)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="{left!r} {top!r} {size}">\n'
        f'<g fill="none" stroke="#000000" stroke-width="0.1">\n{paths}</g>\n</svg>\n'
    )


def _path(contour: Contour) -> str:
    (x, y), words = contour.points[0], []
    for side in contour.sides:
        (u, v), bulge = side[1], side[2]
        arc = f"A{radius_of(side)!r} {radius_of(side)!r} 0 0 {int(bulge > 0)} {u!r} {v!r}"
        words.append(arc if bulge else f"L{u!r} {v!r}")
    return f"M{x!r} {y!r}{''.join(words)}Z"


def _dxf(contours: Sequence[Contour]) -> str:
    import ezdxf

    with without_time():
        document = ezdxf.new("R2010", units=4)  # type: ignore[attr-defined]
        model = document.modelspace()
        for contour in contours:
            drawn = placed(contour, 1000.0, (0.0, 0.0), 9)
            if (whole := drawn.as_circle) is not None:
                model.add_circle(whole[:2], whole[2])
                continue
            bulges = drawn.bulges or (0.0,) * len(drawn.points)
            rows = [(x, y, bulge) for (x, y), bulge in zip(drawn.points, bulges, strict=True)]
            model.add_lwpolyline(rows, format="xyb", close=True)
        stream = io.StringIO()
        document.write(stream)
        return stream.getvalue()


def _geojson(contours: Sequence[Contour]) -> str:
    if any(contour.has_arcs for contour in contours):
        raise InputError("an outline without arcs for GeoJSON", "arcs", "write .svg or .dxf, which have them")
    rings = [[*ring.tolist(), ring[0].tolist()] for ring in polygons_of(contours)]
    return json.dumps({"type": "Polygon", "coordinates": rings}) + "\n"


WRITERS: dict[str, Callable[[Sequence[Contour]], str]] = {".svg": _svg, ".dxf": _dxf, ".geojson": _geojson}
"""Functions that make the text of a file from contours in m, by ending."""
