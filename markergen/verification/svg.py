"""Read circles of an SVG with all transforms and units, by the outline reader, which shares no code with the writer."""

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.guard import Content, check_size
from markergen.model.marker import Marker
from markergen.read.outlines.curves import Arc, Bezier, Curve
from markergen.read.outlines.formats import OUTLINE_FORMATS, OutlineFile
from markergen.read.outlines.svg import parse
from markergen.verification.reading import READERS, Page, Reading, circles_of, round_shape

Array = NDArray[np.float64]

PATIENCE = 30
"""Factor by which path data may exceed that of an outline: sheets contain text converted to outlines."""

_ALONG = np.linspace(0, 1, 5)[:-1, None, None]
"""Parameters of the points sampled on a Bezier curve; computed once, since a sheet has thousands of curves."""


@READERS.register(".svg")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Read the circles and corners of an SVG."""
    check_size(Content(name, data), "SVG")
    file = OutlineFile(name, data, PATIENCE)
    with np.errstate(all="ignore"):
        drawing = OUTLINE_FORMATS["svg"].read(file, None)
        if drawing.scale is None:
            raise InputError(f"a width and height with units in {name}", "none", "save it with its size in mm")
        factor = np.array([1e3, -1e3]) * drawing.scale
        circles, corners = [], []
        for piece in drawing.pieces:
            points = np.concatenate([_points(curve) for curve in piece.curves]) * factor
            found = round_shape(points)
            if found:
                circles.append(found)
            elif len(points) >= 3:
                corners.append(points)
    root = parse(file)
    return Reading(
        "SVG",
        (Page(circles_of(circles, name), _size(root.get("width"), root.get("height")), _joined(corners)),),
        tagged=True,
    )


def _points(curve: Curve) -> Array:
    """Sample a curve, densely enough to preserve its shape if it is bent."""
    if isinstance(curve, Arc):
        t = np.linspace(curve.start, curve.start + curve.sweep, 33)[:-1, None]
        return np.asarray(curve.center + curve.u * np.cos(t) + curve.v * np.sin(t))
    if isinstance(curve, Bezier):
        points = curve.points[None]
        while points.shape[1] > 1:
            points = (1 - _ALONG) * points[:, :-1] + _ALONG * points[:, 1:]
        return points[:, 0]
    return curve.sketch()


def _joined(corners: list[Array]) -> Array:
    points = np.concatenate(corners) if corners else np.zeros((0, 2))
    return points[np.isfinite(points).all(axis=-1)]


def _size(width: str | None, height: str | None) -> tuple[float, float] | None:
    from svgelements import Length

    try:
        # At 25.4 px per inch, 1 px is 1 mm.
        found = tuple(float(Length(text or "").value(ppi=25.4)) for text in (width, height))
    except (ValueError, TypeError, AttributeError):
        return None
    return (found[0], found[1]) if np.isfinite(found).all() else None
