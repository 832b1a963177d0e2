"""Fabrication drawing of a rig: the whole on its first sheets, then each face on its own."""

from markergen.exporters import RIG_EXPORTERS, Exporter

RIG_EXPORTERS.register(".fab.pdf")(
    Exporter(
        "markergen.exporters.fab_pdf:export_rig",
        "drawing of the whole with its faces' relation, then of each face, for the workshop",
        holds="solid",
    )
)
