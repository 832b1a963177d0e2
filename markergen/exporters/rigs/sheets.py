"""Sheets of a rig: all its plates at true size with their names and neighbors, or the paper net of a body."""

from markergen.drawing.paper_net import net_sheet
from markergen.drawing.plate_edges import plate_edges, plate_labels
from markergen.drawing.scene import Shape, Sheet
from markergen.drawing.sheet_layout import one_page, pages_for
from markergen.exporters import RIG_EXPORTERS, Exporter, ExportOptions, Output
from markergen.model.marker import Marker
from markergen.model.rig import Rig


def _labeled(rig: Rig) -> tuple[list[Marker], list[tuple[Shape, ...]]]:
    edges = plate_edges(rig)
    return [each.marker for each in rig.markers], [plate_labels(rig, k, own, 0.9) for k, own in enumerate(edges)]


def _page(rig: Rig, options: ExportOptions, suffix: str) -> Sheet:
    if options.net:
        return net_sheet(rig, options.sheet)
    markers, labels = _labeled(rig)
    return one_page(markers, options.sheet, suffix, labels)


def write_pdf(rig: Rig, options: ExportOptions) -> Output:
    """All plates as PDF, as many on each page as fit, or the net."""
    from markergen.exporters import pdf

    markers, labels = _labeled(rig)
    sheets = (net_sheet(rig, options.sheet),) if options.net else pages_for(markers, options.sheet, labels)
    return Output(pdf.write_pdf(sheets), tuple(dict.fromkeys(note for sheet in sheets for note in sheet.notes)))


def write_svg(rig: Rig, options: ExportOptions) -> Output:
    """All plates on one page as SVG, or the net."""
    from markergen.exporters import svg

    sheet = _page(rig, options, ".svg")
    return Output(svg.write_svg(sheet), sheet.notes)


def write_png(rig: Rig, options: ExportOptions) -> Output:
    """All plates on one page as PNG, or the net."""
    from markergen.exporters import png

    png.check_image(options)
    sheet = _page(rig, options, ".png")
    return Output(png.write_png(sheet, options.dpi), sheet.notes)


RIG_EXPORTERS.register(".pdf")(
    Exporter(write_pdf, "to print all plates, or a net (--net)", holds="flat", sheet=True, many_pages=True)
)
RIG_EXPORTERS.register(".svg")(Exporter(write_svg, "the same on one page, to edit", holds="flat", sheet=True))
RIG_EXPORTERS.register(".png")(
    Exporter(
        write_png,
        "the same in pixels, see --dpi",
        holds="flat",
        sheet=True,
        check="markergen.exporters.png:check_image",
    )
)
