"""Shapes drawn on a page of reportlab's canvas, in mm, for all PDF formats."""
# tests: tests/exporters/test_pdf.py

from io import BytesIO
from math import cos, pi, sin, tan
from typing import Any

import markergen
from markergen.drawing.colors import channels, spot_name
from markergen.drawing.paper import Paper
from markergen.drawing.scene import Disk, Line, Point, Segment, Shape
from markergen.errors import InputError

POINTS_PER_MM = 72 / 25.4
"""PDF's default user space has 72 units to the inch."""

ARCS = 16
"""Bezier arcs per circle. The radial error falls with the sixth power of their angle: 2.7e-4 of the radius for 4 arcs
(5 um on a 36 mm dot), 7e-8 for 16.
"""

DIGITS = 4
"""Decimals of coordinates in points: 35 nm, as near as the 32-bit floats of readers come on large pages."""

MOST_POINTS = 14400
"""Maximum side of a page that readers must accept, 5.08 m (PDF's appendix on limits)."""


def bare_canvas(buffer: BytesIO, title: str, subject: str, *keywords: str) -> Any:
    """Make a canvas for drawings to scale, with metadata and the same bytes every time.

    It asks the program that prints it for true size on paper of the page's size, and selects no font: by default
    reportlab lists Helvetica, unembedded, on every page.
    """
    from reportlab import rl_config
    from reportlab.pdfbase.pdfdoc import PDFDictionary, PDFName
    from reportlab.pdfgen.canvas import Canvas

    class BareCanvas(Canvas):  # type: ignore[misc]  # reportlab has no types
        def _make_preamble(self) -> None:
            # reportlab's own preamble selects a font, which the page would refer to although it has no text.
            self._preamble = "1 0 0 1 0 0 cm"

        def save(self) -> None:
            # In base 85, as by default, a sheet takes a third longer to write, and is a quarter larger.
            default, rl_config.useA85 = rl_config.useA85, 0
            try:
                super().save()
            finally:
                rl_config.useA85 = default

    # Preferences about trays and duplex printing require PDF 1.7, layers 1.5.
    canvas = BareCanvas(buffer, pdfVersion=(1, 7), pageCompression=1, invariant=1)
    preferences = {"PrintScaling": PDFName("None"), "PickTrayByPDFSize": "true"}
    canvas._doc.Catalog.ViewerPreferences = PDFDictionary(preferences)
    canvas.setTitle(title)
    canvas.setSubject(subject)
    canvas.setAuthor("markergen")
    canvas.setCreator(f"markergen {markergen.__version__}")
    canvas.setKeywords(["fiducial marker", title, *keywords])
    return canvas


def page_size(paper: Paper) -> tuple[float, float]:
    """Width and height in points.

    Raises
    ------
    InputError
        If the paper is larger than PDF readers must accept.
    """
    if max(paper.width, paper.height) * POINTS_PER_MM > MOST_POINTS:
        raise InputError("a page of at most 5080 mm, PDF's limit", str(paper), "use a smaller paper or .svg")
    return paper.width * POINTS_PER_MM, paper.height * POINTS_PER_MM


def draw_shape(canvas: Any, shape: Shape) -> None:
    """Paint a shape (mm): lines are stroked, all others filled; spot colors overprint."""
    if isinstance(shape, Line):
        canvas.setStrokeColor(pdf_color(shape.color))
        canvas.setStrokeOverprint(spot_name(shape.color) is not None)
        canvas.setLineWidth(shape.width * POINTS_PER_MM)
        points = shape.points[:-1] if shape.closed else shape.points
        end: tuple[Segment, ...] = (("Z", ()),) if shape.closed else ()
        canvas.addLiteral(_path((("M", points[:1]), *(("L", (point,)) for point in points[1:]), *end)) + " S")
        return
    canvas.setFillColor(pdf_color(shape.color))
    canvas.setFillOverprint(spot_name(shape.color) is not None)
    if isinstance(shape, Disk):
        rings = [_path(_circle(shape.x, shape.y, radius)) for radius in (shape.radius, shape.inner_radius) if radius]
        canvas.addLiteral(" ".join(rings) + " f*")  # even-odd: the hole is not painted
    else:
        canvas.addLiteral(_path(shape.segments) + " f")  # nonzero winding, as in fonts


def _circle(x: float, y: float, radius: float) -> tuple[Segment, ...]:
    """Cubic arcs through points of the circle, tangent there, with handles of length 4/3 tan(angle/4) radius."""
    step = 2 * pi / ARCS
    handle = 4 / 3 * tan(step / 4)

    def at(index: int, along: float) -> Point:
        angle = index * step
        return (
            x + radius * (cos(angle) - along * sin(angle)),
            y + radius * (sin(angle) + along * cos(angle)),
        )

    arcs = tuple(("C", (at(i, handle), at(i + 1, -handle), at(i + 1, 0))) for i in range(ARCS))
    return (("M", (at(0, 0),)), *arcs, ("Z", ()))


def _path(segments: tuple[Segment, ...]) -> str:
    """Operators of a path of segments (mm), with quadratic curves as cubic ones: PDF has no others.

    Our own, because reportlab takes half of the time to write a sheet for formatting numbers, to 7 digits.
    """
    tokens: list[str] = []
    here: Point = (0.0, 0.0)
    for command, in_mm in segments:
        if command == "Z":
            tokens.append("h")
            continue
        points = in_mm
        if command == "Q":
            (cx, cy), (ex, ey) = in_mm
            # Degree elevation: a cubic's handles are two thirds of the way to the quadratic's control point.
            first = here[0] + 2 / 3 * (cx - here[0]), here[1] + 2 / 3 * (cy - here[1])
            points = first, (ex + 2 / 3 * (cx - ex), ey + 2 / 3 * (cy - ey)), (ex, ey)
        numbers = (f"{side * POINTS_PER_MM:.{DIGITS}f}" for point in points for side in point)
        tokens += [number.rstrip("0").rstrip(".") for number in numbers]
        tokens.append(_OPERATORS[command])
        here = in_mm[-1]
    return " ".join(tokens)


_OPERATORS = {"M": "m", "L": "l", "C": "c", "Q": "c"}


def pdf_color(color: str) -> Any:
    """Color for reportlab: RGB, or a spot color with its screen color as CMYK tint."""
    from reportlab.lib.colors import CMYKColorSep, Color, rgb2cmyk

    red, green, blue = (channel / 255 for channel in channels(color))
    name = spot_name(color)
    if name is None:
        return Color(red, green, blue)
    return CMYKColorSep(*rgb2cmyk(red, green, blue), spotName=name)
