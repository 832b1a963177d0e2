"""PDF at true size: only paths, no fonts, with layers that viewers can switch; the same bytes every time."""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

from markergen.drawing.scene import Sheet
from markergen.exporters.pdf_canvas import POINTS_PER_MM, bare_canvas, draw_shape, metadata, page_size


def write_pdf(sheets: Sequence[Sheet]) -> bytes:
    """Write sheets as the pages of a PDF, each exactly as large as its paper, with metadata from the first.

    Layers are painted in order, each as optional content of the same name, initially visible. A spot color is a
    Separation that overprints, so that everything beneath it is preserved. Programs that print it are asked for true
    size, and for one side of the paper.
    """
    from reportlab.pdfbase.pdfdoc import PDFName

    sizes = [page_size(sheet.paper) for sheet in sheets]
    buffer = BytesIO()
    canvas = bare_canvas(buffer, pageCompression=1, invariant=1)
    # Tiles are cut, and markers are laid face up.
    canvas._doc.Catalog.ViewerPreferences["Duplex"] = PDFName("Simplex")
    first = sheets[0]
    for name, value in metadata(first.title, first.description, "print at 100 %").items():
        getattr(canvas, f"set{name.title()}")(value)
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
