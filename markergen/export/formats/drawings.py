"""Sheets to print, and outlines to cut."""

from markergen.export import EXPORTERS, Exporter

EXPORTERS.register(".pdf")(
    Exporter(
        "markergen.export.pdf:export",
        "to print, all pages; with layers and trim box",
        holds="flat",
        sheet=True,
        many_pages=True,
    )
)
EXPORTERS.register(".svg")(
    Exporter("markergen.export.svg:export", "to print or edit, one page", holds="flat", sheet=True)
)
EXPORTERS.register(".png")(
    Exporter(
        "markergen.export.png:export",
        "pixels, one page; see --dpi",
        holds="flat",
        sheet=True,
        check="markergen.export.png:check_image",
    )
)
EXPORTERS.register(".dxf")(
    Exporter("markergen.export.dxf:export", "to cut and engrave, R2010 in mm; see --process laser", holds="flat")
)
