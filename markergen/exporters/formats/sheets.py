"""Sheets to print: markers, all plates of a rig with their names and neighbors, or the paper net of a rig."""
# tests: tests/contracts/test_exporters.py

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markergen.exporters import EXPORTERS, Exporter, ExportOptions, Output, only

if TYPE_CHECKING:
    from markergen.drawing.scene import Shape, Sheet
    from markergen.model.marker import Marker
    from markergen.model.rig import Rig


def export_pdf(bodies: Sequence["Marker | Rig"], options: ExportOptions) -> Output:
    """All pages as PDF: text as outlines, with layers and trim box."""
    from markergen.drawing.paper_net import net_sheet
    from markergen.drawing.sheet_layout import pages_for
    from markergen.exporters.pdf import write_pdf

    if options.net:
        sheets: Sequence[Sheet] = (net_sheet(only(bodies), options.sheet),)
    else:
        markers, labels = _labeled(bodies)
        sheets = pages_for(markers, options.sheet, labels)
    return Output(write_pdf(sheets), tuple(dict.fromkeys(note for sheet in sheets for note in sheet.notes)))


def export_svg(bodies: Sequence["Marker | Rig"], options: ExportOptions) -> Output:
    """One page as SVG, to print or to edit."""
    from markergen.exporters.svg import write_svg

    sheet = _page(bodies, options, ".svg")
    return Output(write_svg(sheet), sheet.notes)


def export_png(bodies: Sequence["Marker | Rig"], options: ExportOptions) -> Output:
    """One page as PNG, in grey levels or RGB."""
    from markergen.exporters.png import check_image, image_size, write_png

    check_image(options)
    sheet = _page(bodies, options, ".png")
    width, height = image_size(sheet.paper, options.dpi)
    note = f"The image has {width} x {height} pixels and says that they are {options.dpi} to the inch."
    return Output(write_png(sheet, options.dpi), (*sheet.notes, note))


def _page(bodies: Sequence["Marker | Rig"], options: ExportOptions, suffix: str) -> "Sheet":
    from markergen.drawing.paper_net import net_sheet
    from markergen.drawing.sheet_layout import one_page

    if options.net:
        return net_sheet(only(bodies), options.sheet)
    markers, labels = _labeled(bodies)
    return one_page(markers, options.sheet, suffix, labels)


def _labeled(bodies: Sequence["Marker | Rig"]) -> tuple[list["Marker"], list[tuple["Shape", ...]]]:
    """Markers of all plates, and the names and neighbors of those of a rig, to print beside them."""
    from markergen.drawing.plate_edges import plate_edges, plate_labels

    markers = [plate.marker for body in bodies for plate in body.plates]
    rigs = [body for body in bodies if body.frame == "rig"]
    return markers, [plate_labels(rig, k, edges, 0.9) for rig in rigs for k, edges in enumerate(plate_edges(rig))]


EXPORTERS.register(".pdf")(
    Exporter(
        export_pdf,
        "to print, all pages; with layers and trim box",
        holds="flat",
        sheet=True,
        many_pages=True,
        rig_description="to print all plates, or a net (--net)",
    )
)
EXPORTERS.register(".svg")(
    Exporter(
        export_svg,
        "to print or edit, one page",
        holds="flat",
        sheet=True,
        rig_description="the same on one page, to edit",
    )
)
EXPORTERS.register(".png")(
    Exporter(
        export_png,
        "pixels, one page; see --dpi",
        holds="flat",
        sheet=True,
        check="markergen.exporters.png:check_image",
        rig_description="the same in pixels, see --dpi",
    )
)
