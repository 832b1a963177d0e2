"""Sheets to print."""

from markergen.exporters import EXPORTERS, Exporter

EXPORTERS.register(".pdf")(
    Exporter(
        "markergen.exporters.pdf:export",
        "to print, all pages; with layers and trim box",
        holds="flat",
        sheet=True,
        many_pages=True,
    )
)
EXPORTERS.register(".svg")(
    Exporter("markergen.exporters.svg:export", "to print or edit, one page", holds="flat", sheet=True)
)
EXPORTERS.register(".png")(
    Exporter(
        "markergen.exporters.png:export",
        "pixels, one page; see --dpi",
        holds="flat",
        sheet=True,
        check="markergen.exporters.png:check_image",
    )
)
