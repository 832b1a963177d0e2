"""The room for a marker's dots: its boundary and what to keep out of, brought into the marker frame together."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markergen.errors import InputError
from markergen.files import exists
from markergen.geometry.contour import placed
from markergen.model.boundary import Boundary, polygon_from
from markergen.read.outlines.boundary import is_drawing, parse_boundary


def read_room(
    boundary: str | None,
    keep_outs: Sequence[str] = (),
    unit: str | None = None,
    layer: str | None = None,
    origin: str = "center",
) -> tuple[Boundary | None, tuple[Boundary, ...]]:
    """Read a boundary and its keep-outs, both in m in the marker frame.

    Keep-outs from a drawing move with a boundary from a drawing: both are in the frame that it was drawn in. What is
    written as a shape, ``circle:3mm@40mm,-20mm``, is in the marker frame already.

    Parameters
    ----------
    boundary : str or None
        See `parse_boundary`; None is none.
    keep_outs : sequence of str
        Shapes or drawings; ``plate.dxf#HOLES`` takes what is on one layer.
    unit, layer, origin : str
        Of `parse_boundary`; the unit is also that of keep-outs.

    Raises
    ------
    InputError
        See `parse_boundary`.
    """
    drawings = [text for text in (boundary, *keep_outs) if text is not None and is_drawing(_split(text)[0])]
    if unit is not None and not drawings:
        raise InputError("a drawing that --boundary-unit is for", "none", "write the unit with the number: 150mm")
    if boundary is None:
        return None, tuple(_keep_out(text, unit, (0.0, 0.0)) for text in keep_outs)
    drawn = is_drawing(boundary)
    found = parse_boundary(boundary, unit if drawn else None, layer, "file" if drawn else origin)
    shift = found.center if drawn and origin == "center" else (0.0, 0.0)
    if drawn:
        found = polygon_from(found.contours(), origin)
    return found, tuple(_keep_out(text, unit, shift) for text in keep_outs)


def drawn_plate(values: Mapping[str, Any]) -> dict[str, Any]:
    """Table of the substrate for a boundary from a drawing: the drawing is the plate, and has no edge.

    That is written down, since a rectangle that was drawn is like one that was written with its measures.

    Raises
    ------
    InputError
        If there is an edge, and no outline for the plate.
    """
    if values.get("outline") is not None:
        return dict(values)
    if values.get("edge"):
        raise InputError(
            "an edge around a disk or a rectangle alone",
            "--edge with a drawing, whose outline is the plate's",
            "leave out --edge, or draw the plate and give it as --outline",
        )
    return {**values, "edge": 0.0}


def _keep_out(text: str, unit: str | None, shift: tuple[float, float]) -> Boundary:
    path, layer = _split(text)
    if not is_drawing(path):
        return parse_boundary(text, origin="file")
    drawn = parse_boundary(path, unit, layer, "file")
    return polygon_from([placed(contour, 1.0, shift, 12) for contour in drawn.contours()], "file")


def _split(text: str) -> tuple[str, str | None]:
    path, mark, layer = text.rpartition("#")
    if not mark or not path or exists(Path(text)):
        return text, None
    return path, layer
