"""PDF at true size: filled paths alone, no fonts, the same bytes from run to run."""

from io import BytesIO
from math import cos, pi, sin, tan
from typing import Any

import markergen
from markergen.drawing.scene import Disk, Line, Point, Segment, Shape
from markergen.drawing.sheet import Sheet, sheet_for
from markergen.export import EXPORTERS, ExportOptions, Output
from markergen.model.marker import Marker

POINTS_PER_MM = 72 / 25.4

ARCS = 16
"""Bezier arcs per circle. The radial error falls with the sixth power of their angle: 4 arcs are off by 2.7e-4 of the
radius (5 um on a 36 mm dot), 16 by 7e-8."""


@EXPORTERS.register(".pdf")
def export(marker: Marker, options: ExportOptions) -> Output:
    """Sheet of the marker as PDF."""
    sheet = sheet_for(marker, options.paper)
    return Output(write_pdf(sheet), sheet.notes)


def write_pdf(sheet: Sheet) -> bytes:
    """Write a sheet as a one-page PDF of the paper's exact size, with the sheet's title and description as metadata.

    Coordinates are written with 1e-3 pt (0.4 um) or finer. Layers are painted in order.
    """
    from reportlab.pdfgen.canvas import Canvas

    class PathCanvas(Canvas):  # type: ignore[misc]  # reportlab has no types
        """A canvas that selects no font: reportlab otherwise lists Helvetica, unembedded, on every page."""

        def _make_preamble(self) -> None:
            self._preamble = "1 0 0 1 0 0 cm"

    buffer = BytesIO()
    size = sheet.paper.width * POINTS_PER_MM, sheet.paper.height * POINTS_PER_MM
    canvas = PathCanvas(buffer, pagesize=size, pageCompression=1, invariant=1)
    canvas.setTitle(sheet.title)
    canvas.setSubject(sheet.description)
    canvas.setAuthor("markergen")
    canvas.setCreator(f"markergen {markergen.__version__}")
    canvas.setKeywords(["fiducial marker", sheet.title, "print at 100 %"])
    for shape in sheet.scene:
        _draw(canvas, shape)
    canvas.showPage()
    canvas.save()
    return buffer.getvalue()


def _draw(canvas: Any, shape: Shape) -> None:
    path = canvas.beginPath()
    if isinstance(shape, Line):
        canvas.setStrokeColor(_rgb(shape.color))
        canvas.setLineWidth(shape.width * POINTS_PER_MM)
        _trace(path, (("M", shape.points[:1]), *(("L", (point,)) for point in shape.points[1:])))
        canvas.drawPath(path, stroke=1, fill=0)
        return
    canvas.setFillColor(_rgb(shape.color))
    if isinstance(shape, Disk):
        for radius in filter(None, (shape.radius, shape.inner_radius)):
            _trace(path, _circle(shape.x, shape.y, radius))
        canvas.drawPath(path, stroke=0, fill=1, fillMode=0)  # even-odd: the hole stays unpainted
    else:
        _trace(path, shape.segments)
        canvas.drawPath(path, stroke=0, fill=1, fillMode=1)  # nonzero winding, as fonts have it


def _circle(x: float, y: float, radius: float) -> tuple[Segment, ...]:
    """Cubic arcs through points of the circle, tangent to it there: handles of length 4/3 tan(angle/4) radius."""
    turn = 2 * pi / ARCS
    handle = 4 / 3 * tan(turn / 4)

    def at(index: int, along: float) -> Point:
        angle = index * turn
        return (
            x + radius * (cos(angle) - along * sin(angle)),
            y + radius * (sin(angle) + along * cos(angle)),
        )

    arcs = tuple(("C", (at(i, handle), at(i + 1, -handle), at(i + 1, 0))) for i in range(ARCS))
    return (("M", (at(0, 0),)), *arcs, ("Z", ()))


def _trace(path: Any, segments: tuple[Segment, ...]) -> None:
    """Replay segments (mm) on a reportlab path (pt), quadratic curves as cubic ones: PDF has no others."""
    here: Point = (0.0, 0.0)
    for command, in_mm in segments:
        points = [(x * POINTS_PER_MM, y * POINTS_PER_MM) for x, y in in_mm]
        if command == "Z":
            path.close()
            continue
        end = points[-1]
        if command == "M":
            path.moveTo(*end)
        elif command == "L":
            path.lineTo(*end)
        elif command == "Q":
            (cx, cy), (ex, ey) = points
            first = here[0] + 2 / 3 * (cx - here[0]), here[1] + 2 / 3 * (cy - here[1])
            path.curveTo(*first, ex + 2 / 3 * (cx - ex), ey + 2 / 3 * (cy - ey), ex, ey)
        else:
            path.curveTo(*points[0], *points[1], *end)
        here = end


def _rgb(color: str) -> Any:
    from reportlab.lib.colors import HexColor

    return HexColor(color)
