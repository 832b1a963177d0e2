"""DXF R2010 in millimeters: the marker itself, without paper, for cutters, engravers and CAD."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any

import numpy as np

import markergen
from markergen.arrays import Array
from markergen.drawing.figure import marker_dots
from markergen.drawing.scene import Disk
from markergen.exporters import ExportOptions, Output, only, without_paper
from markergen.geometry.contour import Contour, area, circle, placed
from markergen.geometry.contour import box as contour_box
from markergen.geometry.outlines import polygon
from markergen.model.boundary import Boundary
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker, marker_name
from markergen.model.openings import holes_beyond, openings
from markergen.read.outlines.dxf import add_contour, as_circle, without_time
from markergen.solid.plate import plate_of
from markergen.solid.primitives import Prism
from markergen.units import format_length
from markergen.workshop.dot_geometry import dots_of
from markergen.workshop.processes import Made

CUT, ENGRAVE, INFO = "CUT", "ENGRAVE", "INFO"
COLORS = {CUT: 1, ENGRAVE: 7, INFO: 5}
"""Color index of each layer: red, black, blue."""

MARKER = {
    CUT: "the boundary and the holes, to be cut",
    ENGRAVE: "outlines of the dots and the tag, to be filled black",
    INFO: "axes, numbers of the dots, countersinks, keep-outs and words, not to be made",
}
"""Meaning of each layer for a sheet."""
PLATE = {
    CUT: "the plate's outline and its holes, to be cut",
    ENGRAVE: "outlines of the dots and the tag, to be engraved dark",
    INFO: "axes, numbers of the dots, countersinks, keep-outs and words, not to be made",
}
"""Meaning of each layer for a plate made by laser."""

NOTE = 2.0
"""Distance of the note from the outline, in heights of its letters."""

NUMBER = 0.4
"""Height of a dot's number relative to the dot's radius: it stands inside the dot."""


@dataclass(frozen=True)
class CutDrawing:
    """Drawing for a cutter: paths by layer, and positions of words; mm.

    Attributes
    ----------
    meaning : mapping
        Meaning of each layer, in words.
    paths : sequence of (layer, path)
    labels : sequence of (words, disk)
        Text for each dot.
    box : array (2, 2)
        Lower left and upper right corner of everything.
    """

    meaning: Mapping[str, str]
    paths: Sequence[tuple[str, Contour]]
    labels: Sequence[tuple[str, Disk]]
    box: Array


def export_dxf(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Outlines of the marker as DXF (R2010, mm), to cut and engrave; of the entire plate if the process engraves it."""
    marker = only(markers, ".dxf")
    engraved = PROCESSES[options.fabrication.process].engraved
    meaning = PLATE if engraved else MARKER
    notes = (
        "DXF units are mm; the origin is the marker's, x right and y up.",
        *(f"Layer {name} has {meaning_words}." for name, meaning_words in meaning.items()),
        *(() if engraved else holes_beyond(marker)),
        *without_paper(options),
    )
    return Output(write_laser_dxf(marker, options.fabrication) if engraved else write_dxf(marker), notes)


def write_dxf(marker: Marker) -> bytes:
    """Write a marker as DXF, with exact circles and arcs, closed polylines for the rest; the same bytes every time."""
    # A measured marker is made again as it was designed.
    designed = marker.as_designed
    dots = marker_dots(designed)
    cut = [contour for contour in designed.boundary.contours() if area(contour) > 0]
    cut += [opening.contour for opening in openings(designed)]
    paths = [(CUT, _path(contour)) for contour in cut]
    paths += [(ENGRAVE, path) for dot in dots for path in _circles(dot)]
    paths += [(ENGRAVE, _path(polygon(ring))) for ring in (designed.tag.outlines if designed.tag else ())]
    paths += _uncut(designed)
    box = _box(np.array([point for layer, path in paths if layer == CUT for point in _extent(path)]))
    return _write(designed, CutDrawing(MARKER, paths, [(dot.name.removeprefix("dot-"), dot) for dot in dots], box))


def write_laser_dxf(marker: Marker, fabrication: Fabrication) -> bytes:
    """Write a plate for a laser as DXF: outline and holes to cut, dots and tag to engrave; a relief in plan view.

    Arcs are exact. Cells of the tag that meet at a corner are separated, as in the solid.

    Raises
    ------
    InputError
        If the process rejects the marker.
    """
    designed = marker.as_designed
    made: Made = PROCESSES[fabrication.process](designed, fabrication)
    outlines = plate_of(designed).outlines
    dots = [(dot, Disk(dot.x, dot.y, dot.radius, dot.inner, dot.name)) for dot in dots_of(designed)]
    paths = [(CUT, path) for outline in outlines for path in outline]
    paths += [(CUT, path) for hole in designed.substrate.holes for path in _paths(hole.bore)]
    paths += [(ENGRAVE, path) for _, disk in dots for path in _circles(disk)]
    marks = [body for body in made.marked if isinstance(body, Prism)]
    paths += [(ENGRAVE, path) for body in marks for path in (body.outer, *body.holes)]
    paths += _uncut(designed)
    labels = [
        (f"{dot.id}, z = {format_length(dot.z / 1e3)}" if dot.raised else str(dot.id), disk) for dot, disk in dots
    ]
    box = _box(np.array([point for outer, *_ in outlines for point in _extent(outer)]))
    return _write(designed, CutDrawing(PLATE, paths, labels, box))


def _write(marker: Marker, drawing: CutDrawing) -> bytes:
    from ezdxf import units
    from ezdxf.filemanagement import new

    with without_time():
        document = new("R2010", units=units.MM)
        for name, color in COLORS.items():
            document.layers.add(name, color=color).description = drawing.meaning[name]
        space = document.modelspace()
        for layer, path in drawing.paths:
            add_contour(space, path, {"layer": layer})
        _inform(space, marker, drawing)
        # The box of all paths, and of the note below them.
        points = np.array([point for _, path in drawing.paths for point in _extent(path)])
        low, high = np.minimum(points.min(axis=0), drawing.box[0] - [0.0, NOTE * _size(drawing)]), points.max(axis=0)
        space.reset_extents((*low, 0.0), (*high, 0.0))
        space.reset_limits(low, high)
        document.set_modelspace_vport(1.1 * float(high[1] - low[1]), tuple((low + high) / 2))
        # ezdxf would add these in the order of a set, which differs between processes.
        for kind in sorted(document.entitydb.dxf_types_in_use()):
            document.classes.add_class(kind)
        stream = StringIO()
        document.write(stream)
        return document.encode(stream.getvalue())


def _size(drawing: CutDrawing) -> float:
    """Height of letters, mm."""
    return max(float(drawing.box[1][0] - drawing.box[0][0]), 1.0) / 50


def _inform(space: Any, marker: Marker, drawing: CutDrawing) -> None:
    """Add the axes, each dot's number inside it, and the marker's name below the outline."""
    from ezdxf.enums import TextEntityAlignment

    def write(content: str, x: float, y: float, height: float, align: Any) -> None:
        space.add_text(content, height=height, dxfattribs={"layer": INFO}).set_placement((x, y), align=align)

    left, bottom = drawing.box[0].tolist()
    size = _size(drawing)
    arm = 4 * size
    for name, tip, at in (("x", (arm, 0.0), (1.2 * arm, 0.0)), ("y", (0.0, arm), (0.0, 1.2 * arm))):
        space.add_line((0, 0), tip, dxfattribs={"layer": INFO})
        write(name, at[0], at[1], size, TextEntityAlignment.MIDDLE_CENTER)
    for number, dot in drawing.labels:
        height = NUMBER * dot.radius * min(1.0, 5 / len(number))
        write(number, dot.x, dot.y, height, TextEntityAlignment.MIDDLE_CENTER)
    note = f"{marker_name(marker)}, {len(marker)} dots, millimeters, made with markergen {markergen.__version__}"
    write(note, left, bottom - NOTE * size, size * min(1.0, 60 / len(note)), TextEntityAlignment.LEFT)


def _uncut(marker: Marker) -> list[tuple[str, Contour]]:
    """Countersinks and keep-outs, which are not cut."""
    sinks = [hole.rim for hole in marker.substrate.holes if hole.sink]
    return [(INFO, path) for shape in (*sinks, *marker.keep_outs) for path in _paths(shape)]


def _paths(outline: Boundary) -> list[Contour]:
    return [_path(contour) for contour in outline.contours()]


def _path(contour: Contour) -> Contour:
    return placed(contour, 1e3, digits=9)


def _circles(dot: Disk) -> list[Contour]:
    return [circle(radius, dot.x, dot.y) for radius in (dot.radius, dot.inner_radius) if radius]


def _extent(path: Contour) -> list[tuple[float, float]]:
    """Points with the same bounding box as a path."""
    if (disk := as_circle(path)) is not None:
        x, y, radius = disk
        return [(x - radius, y - radius), (x + radius, y + radius)]
    left, bottom, right, top = contour_box(path)
    return [(left, bottom), (right, top)]


def _box(points: Array) -> Array:
    return np.stack([points.min(axis=0), points.max(axis=0)])
