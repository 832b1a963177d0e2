"""Sheets to print: markers, all plates of a rig with their names and neighbors, or the paper net of a rig.

A PDF has only paths, no fonts, and layers that viewers can switch; an SVG exact circles in mm, no transforms, and text
as outlines. Both have the same bytes every time.
"""
# tests: tests/contracts/test_exporters.py tests/exporters/test_svg.py tests/exporters/test_pdf.py

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from markergen.drawing.colors import rgb, spot_name
from markergen.drawing.scene import Disk, FilledPath, Line, Shape, Sheet
from markergen.exporters import EXPORTERS, Exporter, ExportOptions, Output, only
from markergen.exporters.pdf_canvas import POINTS_PER_MM, bare_canvas, draw_shape, page_size
from markergen.model.fabrication import PROCESSES

if TYPE_CHECKING:
    from markergen.model.marker import Marker
    from markergen.model.rig import Rig


LEAST_ROUND, EVEN = 16, 1e-6
"""Minimum number of points of a line that is drawn as a circle, and maximum difference in mm of its radii and sides."""


def export_pdf(bodies: Sequence["Marker | Rig"], options: ExportOptions) -> Output:
    """All pages as PDF: text as outlines, with layers and trim box."""
    sheets = _sheets(bodies, options)
    return Output(write_pdf(sheets), tuple(dict.fromkeys(note for sheet in sheets for note in sheet.notes)))


def export_svg(bodies: Sequence["Marker | Rig"], options: ExportOptions) -> Output:
    """One page as SVG, to print or to edit."""
    (sheet,) = _sheets(bodies, options, ".svg")
    cut = PROCESSES[options.fabrication.process].engraved
    return Output(write_svg(sheet, filled=not cut), sheet.notes)


def export_png(bodies: Sequence["Marker | Rig"], options: ExportOptions) -> Output:
    """One page as PNG, in grey levels or RGB."""
    from markergen.exporters.png import check_image, image_size, write_png

    check_image(options)
    (sheet,) = _sheets(bodies, options, ".png")
    width, height = image_size(sheet.paper, options.dpi)
    note = f"The image has {width} x {height} pixels and says that they are {options.dpi} to the inch."
    return Output(write_png(sheet, options.dpi), (*sheet.notes, note))


def _sheets(bodies: Sequence["Marker | Rig"], options: ExportOptions, one_page_of: str = "") -> Sequence[Sheet]:
    """All pages, or the only one of a format without more; beside plates of a rig their names and neighbors."""
    from markergen.drawing.paper_net import net_sheet, sheet_labels
    from markergen.drawing.sheet_layout import one_page, pages_for

    if options.net:
        return (net_sheet(only(bodies), options.sheet),)
    markers = [plate.marker for body in bodies for plate in body.plates]
    labels = [shapes for body in bodies if body.frame == "rig" for shapes in sheet_labels(body)]
    if one_page_of:
        return (one_page(markers, options.sheet, one_page_of, labels),)
    return pages_for(markers, options.sheet, labels)


_SHEET = partial(Exporter, holds="flat", sheet=True)

EXPORTERS.register(".pdf")(
    _SHEET(
        export_pdf,
        "to print, all pages; with layers and trim box",
        many_pages=True,
        rig_description="to print all plates, or a net (--net)",
    )
)
EXPORTERS.register(".svg")(
    _SHEET(export_svg, "to print or edit, one page", rig_description="the same on one page, to edit")
)
EXPORTERS.register(".png")(
    _SHEET(
        export_png,
        "pixels, one page; see --dpi",
        check="markergen.exporters.png:check_image",
        rig_description="the same in pixels, see --dpi",
    )
)


def write_svg(sheet: Sheet, filled: bool = True) -> bytes:
    """Write a sheet as SVG 1.1 with one group per layer and an ``id`` per shape (``dot-0``, ...).

    The page is white unless it is not `filled`: a laser would engrave it.

    Groups are also layers in Inkscape, with the layer's name; the label of a group with a spot color states it. User
    units are mm; y points down as in SVG, so y_svg = page height - y. Circles are exact: ``circle`` elements, and
    half-circle arcs with the even-odd rule for annuli. Numbers have 6 decimals (1 nm).
    """
    width, height = _number(sheet.paper.width), _number(sheet.paper.height)
    spaces = {
        "xmlns": "http://www.w3.org/2000/svg",
        "xmlns:inkscape": "http://www.inkscape.org/namespaces/inkscape",
    }
    size = {"width": f"{width}mm", "height": f"{height}mm", "viewBox": f"0 0 {width} {height}"}
    root = Element("svg", {**spaces, "version": "1.1", **size})
    SubElement(root, "title").text = sheet.title
    SubElement(root, "desc").text = sheet.description
    if filled:
        SubElement(root, "rect", {"id": "paper", "width": width, "height": height, "fill": "#ffffff"})
    used = {"paper": 1, **{layer.name: 1 for layer in sheet.scene.layers}}
    for layer in sheet.scene.layers:
        spots = dict.fromkeys(filter(None, (spot_name(shape.color) for shape in layer.shapes)))
        label = " ".join([layer.name, *(f"({spot})" for spot in spots)])
        group = SubElement(root, "g", {"id": layer.name, "inkscape:groupmode": "layer", "inkscape:label": label})
        for shape in layer.shapes:
            used[shape.name] = used.get(shape.name, 0) + 1
            number = f"-{used[shape.name]}" if shape.name and used[shape.name] > 1 else ""
            _add(group, replace(shape, name=shape.name + number), sheet.paper.height)
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
            kind = "polygon" if shape.closed else "polyline"
            measures = {"points": " ".join(f"{_number(x)},{_number(page - y)}" for x, y in points)}
            if (disk := _round(shape)) is not None:
                x, y, radius = disk
                kind, measures = "circle", {"cx": _number(x), "cy": _number(page - y), "r": _number(radius)}
            stroke = {"fill": "none", "stroke": rgb(shape.color), "stroke-width": _number(shape.width)}
            SubElement(group, kind, {**name, **measures, **stroke})
        case FilledPath():
            path = " ".join(
                command + " ".join(f"{_number(x)},{_number(page - y)}" for x, y in points)
                for command, points in shape.segments
            )
            SubElement(group, "path", {**name, "d": path, "fill": rgb(shape.color)})


def _round(line: Line) -> tuple[float, float, float] | None:
    """Center and radius in mm of a circle drawn as a closed line; None for other lines."""
    points = np.array(line.points[:-1])
    if not line.closed or len(points) < LEAST_ROUND:
        return None
    center = points.mean(axis=0)
    radii = np.linalg.norm(points - center, axis=1)
    steps = np.linalg.norm(np.diff(line.points, axis=0), axis=1)
    if np.ptp(radii) > EVEN or np.ptp(steps) > EVEN:
        return None
    return float(center[0]), float(center[1]), float(radii.mean())


def _ring(x: float, y: float, radius: float) -> str:
    start, across, r = f"{_number(x + radius)},{_number(y)}", f"{_number(x - radius)},{_number(y)}", _number(radius)
    return f"M{start} A{r},{r} 0 1 0 {across} A{r},{r} 0 1 0 {start} Z"


def _number(value: float) -> str:
    text = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def write_pdf(sheets: Sequence[Sheet]) -> bytes:
    """Write sheets as the pages of a PDF, each exactly as large as its paper, with metadata from the first.

    Layers are painted in order, each as optional content of the same name, initially visible. A spot color is a
    Separation that overprints, so that everything beneath it is preserved. Programs that print it are asked for true
    size, and for one side of the paper.
    """
    from reportlab.pdfbase.pdfdoc import PDFName

    sizes, first, buffer = [page_size(sheet.paper) for sheet in sheets], sheets[0], BytesIO()
    canvas = bare_canvas(buffer, first.title, first.description, "print at 100 %")
    # Tiles are cut, and markers are laid face up.
    canvas._doc.Catalog.ViewerPreferences["Duplex"] = PDFName("Simplex")
    groups = _layers(canvas, [layer.name for sheet in sheets for layer in sheet.scene.layers])
    for sheet, size in zip(sheets, sizes, strict=True):
        canvas.setPageSize(size)
        canvas.setTrimBox([side * POINTS_PER_MM for side in sheet.trim_mm])
        for layer in sheet.scene.layers:
            canvas.addLiteral(f"/OC /{_property(layer.name)} BDC")
            for shape in layer.shapes:
                draw_shape(canvas, shape)
            canvas.addLiteral("EMC")
        colors = dict(canvas._colorsUsed)
        canvas.showPage()
        _page_resources(canvas, groups, colors)
    canvas.save()
    return buffer.getvalue()


def _property(layer: str) -> str:
    return f"layer-{layer}"


def _layers(canvas: Any, names: Sequence[str]) -> dict[str, Any]:
    """References to an optional content group per layer, registered in the document.

    reportlab does not support these, but writes the entries of its catalog.
    """
    from reportlab.pdfbase.pdfdoc import PDFArray, PDFDictionary, PDFName, PDFString

    document = canvas._doc
    groups = {
        name: document.Reference(PDFDictionary({"Type": PDFName("OCG"), "Name": PDFString(name)}), f"group-{name}")
        for name in dict.fromkeys(names)
    }
    catalog, all_groups = document.Catalog, PDFArray(list(groups.values()))
    catalog.__NoDefault__ = [*catalog.__NoDefault__, "OCProperties"]
    configuration = PDFDictionary({"ON": all_groups, "Order": all_groups, "Name": PDFString("layers")})
    vars(catalog)["OCProperties"] = PDFDictionary({"OCGs": all_groups, "D": configuration})
    return groups


def _page_resources(canvas: Any, groups: dict[str, Any], colors: dict[str, str]) -> None:
    """Name the layers, spot colors and overprint states that the current page refers to."""
    from reportlab.pdfbase.pdfdoc import PDFResourceDictionary

    page = canvas._doc.Pages.pages[-1]
    resources = PDFResourceDictionary(Properties={_property(name): group for name, group in groups.items()})
    if page.ExtGState:
        resources.ExtGState = page.ExtGState
    resources.setColorSpace(colors)
    page.Resources = resources
