"""PDF at true size: paths alone, no fonts, layers that viewers can switch, the same bytes from run to run."""

from collections.abc import Sequence
from io import BytesIO
from math import cos, pi, sin, tan
from typing import Any

import markergen
from markergen.drawing.colors import channels, spot_name
from markergen.drawing.scene import Disk, Line, Point, Segment, Shape, Sheet
from markergen.drawing.sheet_layout import pages_for
from markergen.errors import InputError
from markergen.exporters import ExportOptions, Output
from markergen.model.marker import Marker

POINTS_PER_MM = 72 / 25.4

ARCS = 16
"""Bezier arcs per circle. The radial error falls with the sixth power of their angle: 4 arcs are off by 2.7e-4 of the
radius (5 um on a 36 mm dot), 16 by 7e-8."""

MOST_POINTS = 14400
"""Longest side of a page that readers must accept, 5.08 m (PDF's appendix on limits)."""


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Sheets of the markers as PDF, to print: all pages, text as outlines, with layers and trim box."""
    sheets = pages_for(markers, options.sheet)
    return Output(write_pdf(sheets), tuple(dict.fromkeys(note for sheet in sheets for note in sheet.notes)))


def write_pdf(sheets: Sequence[Sheet]) -> bytes:
    """Write sheets as the pages of a PDF, each of its paper's exact size, with the first one's title as metadata.

    Coordinates are written with 1e-6 pt. Layers are painted in order, each as optional content of its name that is
    on at first. A spot color is a Separation that overprints, so that what lies beneath it stays whole.
    """
    from reportlab.pdfgen.canvas import Canvas

    class PathCanvas(Canvas):  # type: ignore[misc]  # reportlab has no types
        """A canvas that selects no font: reportlab otherwise lists Helvetica, unembedded, on every page."""

        def _make_preamble(self) -> None:
            self._preamble = "1 0 0 1 0 0 cm"

    for sheet in sheets:
        if max(sheet.paper.width, sheet.paper.height) * POINTS_PER_MM > MOST_POINTS:
            raise InputError("a page of at most 5080 mm, PDF's limit", str(sheet.paper), "use a smaller paper or .svg")
    buffer = BytesIO()
    # Optional content came with PDF 1.5.
    canvas = PathCanvas(buffer, pageCompression=1, invariant=1, pdfVersion=(1, 5))
    first = sheets[0]
    canvas.setTitle(first.title)
    canvas.setSubject(first.description)
    canvas.setAuthor("markergen")
    canvas.setCreator(f"markergen {markergen.__version__}")
    canvas.setKeywords(["fiducial marker", first.title, "print at 100 %"])
    groups = _layers(canvas, [layer.name for sheet in sheets for layer in sheet.scene.layers])
    for sheet in sheets:
        canvas.setPageSize((sheet.paper.width * POINTS_PER_MM, sheet.paper.height * POINTS_PER_MM))
        canvas.setTrimBox([side * POINTS_PER_MM for side in sheet.trim_mm])
        for layer in sheet.scene.layers:
            canvas.addLiteral(f"/OC /{_property(layer.name)} BDC")
            for shape in layer.shapes:
                _draw(canvas, shape)
            canvas.addLiteral("EMC")
        colors = dict(canvas._colorsUsed)
        canvas.showPage()
        _page_resources(canvas, groups, colors)
    canvas.save()
    return buffer.getvalue()


def _property(layer: str) -> str:
    return f"layer-{layer}"


def _layers(canvas: Any, names: Sequence[str]) -> dict[str, Any]:
    """References to an optional content group per layer, made known to the document.

    reportlab knows nothing of these, but writes what it finds in its catalog.
    """
    from reportlab.pdfbase.pdfdoc import PDFArray, PDFDictionary, PDFName, PDFString

    document = canvas._doc
    groups = {
        name: document.Reference(PDFDictionary({"Type": PDFName("OCG"), "Name": PDFString(name)}), f"group-{name}")
        for name in dict.fromkeys(names)
    }
    catalog, all_groups = document.Catalog, PDFArray(list(groups.values()))
    catalog.__NoDefault__ = [*catalog.__NoDefault__, "OCProperties"]
    shown = PDFDictionary({"ON": all_groups, "Order": all_groups, "Name": PDFString("layers")})
    vars(catalog)["OCProperties"] = PDFDictionary({"OCGs": all_groups, "D": shown})
    return groups


def _page_resources(canvas: Any, groups: dict[str, Any], colors: dict[str, str]) -> None:
    """Name the layers, the spot colors and the overprint states that the page just shown refers to."""
    from reportlab.pdfbase.pdfdoc import PDFResourceDictionary

    page = canvas._doc.Pages.pages[-1]
    resources = PDFResourceDictionary(Properties={_property(name): group for name, group in groups.items()})
    if page.ExtGState:
        resources.ExtGState = page.ExtGState
    resources.setColorSpace(colors)
    page.Resources = resources


def _draw(canvas: Any, shape: Shape) -> None:
    path = canvas.beginPath()
    if isinstance(shape, Line):
        canvas.setStrokeColor(_color(shape.color))
        canvas.setStrokeOverprint(spot_name(shape.color) is not None)
        canvas.setLineWidth(shape.width * POINTS_PER_MM)
        points = shape.points[:-1] if shape.closed else shape.points
        end: tuple[Segment, ...] = (("Z", ()),) if shape.closed else ()
        _trace(path, (("M", points[:1]), *(("L", (point,)) for point in points[1:]), *end))
        canvas.drawPath(path, stroke=1, fill=0)
        return
    canvas.setFillColor(_color(shape.color))
    canvas.setFillOverprint(spot_name(shape.color) is not None)
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


def _color(color: str) -> Any:
    """Color for reportlab: RGB, or a spot color with what it looks like as its tint in CMYK."""
    from reportlab.lib.colors import CMYKColorSep, Color, rgb2cmyk

    red, green, blue = (channel / 255 for channel in channels(color))
    name = spot_name(color)
    if name is None:
        return Color(red, green, blue)
    return CMYKColorSep(*rgb2cmyk(red, green, blue), spotName=name)
