"""SVG in millimeters: exact circles, no transforms, text as outlines."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from markergen.drawing.scene import Disk, Line, Outline, Shape
from markergen.drawing.sheet import Sheet, sheet_for
from markergen.export import EXPORTERS, ExportOptions, Output
from markergen.model.marker import Marker


@EXPORTERS.register(".svg")
def export(marker: Marker, options: ExportOptions) -> Output:
    """Sheet of the marker as SVG."""
    sheet = sheet_for(marker, options.paper)
    return Output(write_svg(sheet), sheet.notes)


def write_svg(sheet: Sheet) -> bytes:
    """Write a sheet as SVG 1.1 with one group per layer and an ``id`` per shape (``dot-0``, ...).

    User units are mm; y points down as SVG has it, so y_svg = page height - y. Circles are exact: ``circle`` elements,
    and half-circle arcs with the even-odd rule for annuli. Numbers carry 6 decimals (1 nm).
    """
    width, height = _number(sheet.paper.width), _number(sheet.paper.height)
    root = Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "version": "1.1",
            "width": f"{width}mm",
            "height": f"{height}mm",
            "viewBox": f"0 0 {width} {height}",
        },
    )
    SubElement(root, "title").text = sheet.title
    SubElement(root, "desc").text = sheet.description
    SubElement(root, "rect", {"id": "paper", "width": width, "height": height, "fill": "#ffffff"})
    for layer in sheet.scene.layers:
        group = SubElement(root, "g", {"id": layer.name})
        for shape in layer.shapes:
            _add(group, shape, sheet.paper.height)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _add(group: Element, shape: Shape, page: float) -> None:
    name = {"id": shape.name} if shape.name else {}
    match shape:
        case Disk(inner_radius=0.0):
            circle = {"cx": _number(shape.x), "cy": _number(page - shape.y), "r": _number(shape.radius)}
            SubElement(group, "circle", {**name, **circle, "fill": shape.color})
        case Disk():
            rings = " ".join(_ring(shape.x, page - shape.y, r) for r in (shape.radius, shape.inner_radius))
            SubElement(group, "path", {**name, "d": rings, "fill": shape.color, "fill-rule": "evenodd"})
        case Line():
            steps = " ".join(f"{_number(x)},{_number(page - y)}" for x, y in shape.points)
            stroke = {"stroke": shape.color, "stroke-width": _number(shape.width)}
            SubElement(group, "polyline", {**name, "points": steps, "fill": "none", **stroke})
        case Outline():
            path = " ".join(
                command + " ".join(f"{_number(x)},{_number(page - y)}" for x, y in points)
                for command, points in shape.segments
            )
            SubElement(group, "path", {**name, "d": path, "fill": shape.color})


def _ring(x: float, y: float, radius: float) -> str:
    start, across, r = f"{_number(x + radius)},{_number(y)}", f"{_number(x - radius)},{_number(y)}", _number(radius)
    return f"M{start} A{r},{r} 0 1 0 {across} A{r},{r} 0 1 0 {start} Z"


def _number(value: float) -> str:
    text = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
