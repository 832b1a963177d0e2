"""Fabrication sheet: a dimensioned drawing of the solid with tables and notes, for those who make it."""

from collections.abc import Sequence

from markergen.drawing.workshop_pages import fabrication_sheets
from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.pdf import write_pdf
from markergen.exporters.solids import solid_notes
from markergen.model.marker import Marker
from markergen.solid.fabrication_content import workpiece
from markergen.solid.processes import parts_of


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Drawing to scale with dimensions, coordinates, parts, tolerances and notes; it needs no CAD kernel."""
    marker = only(markers, ".fab.pdf").as_designed
    made = parts_of(marker, options.fabrication)
    sheets = fabrication_sheets(workpiece(marker, options.fabrication, made), options.sheet)
    return Output(write_pdf(sheets), (*sheets[0].notes, *solid_notes(marker, made, options)))
