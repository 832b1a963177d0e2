"""SVG in millimeters: exact circles, no transforms, text as outlines."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from markergen.drawing.colors import rgb, spot_name
from markergen.drawing.scene import Disk, FilledPath, Line, Shape, Sheet


def write_svg(sheet: Sheet) -> bytes:
    """Write a sheet as SVG 1.1 with one group per layer and an ``id`` per shape (``dot-0``, ...).

    Groups are also layers in Inkscape, with the layer's name; the label of a group with a spot color states it. User
    units are mm; y points down as in SVG, so y_svg = page height - y. Circles are exact: ``circle`` elements, and
    half-circle arcs with the even-odd rule for annuli. Numbers have 6 decimals (1 nm).
    """
    width, height = _number(sheet.paper.width), _number(sheet.paper.height)
    root = Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "xmlns:inkscape": "http://www.inkscape.org/namespaces/inkscape",
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
        spots = dict.fromkeys(filter(None, (spot_name(shape.color) for shape in layer.shapes)))
        label = " ".join([layer.name, *(f"({spot})" for spot in spots)])
        group = SubElement(root, "g", {"id": layer.name, "inkscape:groupmode": "layer", "inkscape:label": label})
        for shape in layer.shapes:
            _add(group, shape, sheet.paper.height)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _add(group: Element, shape: Shape, page: float) -> None:
    name = {"id": shape.name} if shape.name else {}
    match shape:
        case Disk(inner_radius=0.0):
            circle = {"cx": _number(shape.x), "cy": _number(page - shape.y), "r": _number(shape.radius)}
            SubElement(group, "circle", {**name, **circle, "fill": rgb(shape.color)})
        case Disk():
            rings = " ".join(_ring(shape.x, page - shape.y, r) for r in (shape.radius, shape.inner_radius))
            SubElement(group, "path", {**name, "d": rings, "fill": rgb(shape.color), "fill-rule": "evenodd"})
        case Line():
            points = shape.points[:-1] if shape.closed else shape.points
            steps = " ".join(f"{_number(x)},{_number(page - y)}" for x, y in points)
            stroke = {"stroke": rgb(shape.color), "stroke-width": _number(shape.width)}
            kind = "polygon" if shape.closed else "polyline"
            SubElement(group, kind, {**name, "points": steps, "fill": "none", **stroke})
        case FilledPath():
            path = " ".join(
                command + " ".join(f"{_number(x)},{_number(page - y)}" for x, y in points)
                for command, points in shape.segments
            )
            SubElement(group, "path", {**name, "d": path, "fill": rgb(shape.color)})


def _ring(x: float, y: float, radius: float) -> str:
    start, across, r = f"{_number(x + radius)},{_number(y)}", f"{_number(x - radius)},{_number(y)}", _number(radius)
    return f"M{start} A{r},{r} 0 1 0 {across} A{r},{r} 0 1 0 {start} Z"


def _number(value: float) -> str:
    text = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
